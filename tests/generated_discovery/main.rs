//! Evaluates the residual families of what discovery found, once as `tau generate` writes them and once
//! as `tau_model!` expands them.
//!
//! A line of output holds the names of the parameters, or residuals and Jacobian of one residual at one sample, as bits:
//! of the generated code, then of the macro's.

mod answer;
mod discovered;
mod expanded;

use answer::answer;

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
            let answers = both.map(|variant| answer(variant.instances[index].family, sample));
            println!("{}|{}", answers[0], answers[1]);
        }
    }
}
