//! Evaluates the residual families of what discovery found, once as `tau generate` writes them and once
//! as `tau_model!` expands them.
//!
//! A line of output holds the names of the parameters, or residuals and Jacobian of one residual at one sample, as bits:
//! of the generated code, then of the macro's.

mod discovered;
mod expanded;

/// Arbitrary numbers between 0 and 1; the test has the same.
fn numbers(start: usize, count: usize) -> Vec<f64> {
    let number = |k: usize| ((29 * k + 11) % 97 + 1) as f64 / 98.0;
    (start..start + count).map(number).collect()
}

fn main() {
    let both = [&discovered::ROBOT, expanded::GantryTau::ROBOT].map(|robot| {
        let mut variants = robot.variants.iter();
        let found = variants.find(|variant| variant.name == "Discovered");
        found.expect("what was found")
    });
    let names = both.map(|own| own.parameters.iter().map(|p| p.name).collect::<String>());
    println!("{}|{}", names[0], names[1]);
    for index in 0..both[0].instances.len() {
        for sample in 0..7 {
            let answers = both.map(|variant| {
                let family = variant.instances[index].family;
                let shape = family.shape();
                let parameters = numbers(3 * sample, shape.parameters);
                let mut prepared = vec![0.0; shape.prepared];
                family.prepare(&numbers(sample, shape.data), &mut prepared);
                let mut value = vec![0.0; shape.residuals];
                family.value(&prepared, &parameters, &mut value);
                let mut residuals = vec![0.0; shape.residuals];
                let mut jacobian = vec![0.0; family.pattern().columns.len()];
                family.linearize(&prepared, &parameters, &mut residuals, &mut jacobian);
                let all = [value, residuals, jacobian].concat();
                let bits = all.iter().map(|number| format!("{:x} ", number.to_bits()));
                bits.collect::<String>()
            });
            println!("{}|{}", answers[0], answers[1]);
        }
    }
}
