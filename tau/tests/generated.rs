//! Without any feature of `tau` a crate can declare a robot and call its generated functions.

use tau::runtime::{Input, ResidualKind};
use tau::tau_model;

tau_model! {
    pub robot Slide {
        track rail;
        cluster arm on rail { link rod, second, third; }
        variant Nominal { arm reduced; tracks linear; }
    }
}

#[test]
fn the_closure_is_that_of_the_textbook() {
    let (length_m, command_m) = (2.0, 0.4);
    let offset_m = [0.1, 0.2, 0.3];
    let direction = [0.9, -0.1, 0.2];
    let position_m = [1.1, 0.7, -0.9];

    let variant = Slide::NOMINAL.table();
    let value = |index: u32| {
        let parameter = &variant.parameters[index as usize];
        match (parameter.quantity, parameter.component) {
            ("length", None) => length_m,
            ("track_offset", Some(component)) => offset_m[component],
            ("track_direction", Some(component)) => direction[component],
            other => panic!("{other:?}"),
        }
    };
    let datum = |input: &Input| match *input {
        Input::Command(0) => command_m,
        Input::Position(component) => position_m[component],
        ref other => panic!("{other:?}"),
    };
    let closure = |instance: &&tau::runtime::Instance| instance.kind == ResidualKind::Closure;
    let closure = variant.instances.iter().find(closure).expect("a closure");
    let parameters: Vec<f64> = closure
        .parameters
        .iter()
        .map(|&index| value(index))
        .collect();
    let data: Vec<f64> = closure.inputs.iter().map(datum).collect();
    let mut prepared = vec![0.0; closure.family.shape().prepared];
    closure.family.prepare(&data, &mut prepared);
    let mut residual = [0.0];
    closure.family.value(&prepared, &parameters, &mut residual);

    let squares = (0..3).map(|k| position_m[k] - offset_m[k] - command_m * direction[k]);
    let expected = length_m * length_m - squares.map(|d| d * d).sum::<f64>();
    assert!(
        (residual[0] - expected).abs() < 1e-12,
        "{residual:?} for {expected}"
    );

    let length = slide::nominal::ARM_LENGTH;
    assert_eq!((length.name(), length.table().unit), ("arm.length", "m"));
}
