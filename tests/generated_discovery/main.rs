//! Evaluates the residual families of what discovery found, once as `tau generate` writes them and once
//! as `tau_model!` expands them.
//!
//! Each line of standard input is a sample: index of the residual, then its data and, after a semicolon,
//! its parameters, as bits. Each line of standard output answers one, with the residuals and, after a
//! semicolon, the Jacobian of the generated code, then those of the macro's. Before them stand the names
//! of the variant's parameters.

use std::io::{self, Read};

use tau::runtime::{Robot, Variant};

mod discovered;
mod expanded;

fn variant(robot: &'static Robot) -> &'static Variant {
    let mut variants = robot.variants.iter();
    variants
        .find(|variant| variant.name == "Discovered")
        .expect("what was found")
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace()
        .map(|bits| f64::from_bits(u64::from_str_radix(bits, 16).expect("bits")))
        .collect()
}

fn bits(numbers: &[f64]) -> String {
    let bits: Vec<String> = numbers
        .iter()
        .map(|number| format!("{:x}", number.to_bits()))
        .collect();
    bits.join(" ")
}

fn main() {
    let variants = [
        variant(&discovered::ROBOT),
        variant(expanded::GantryTau::ROBOT),
    ];
    for variant in variants {
        let names: Vec<&str> = variant.parameters.iter().map(|p| p.name).collect();
        println!("{}", names.join(" "));
    }
    let mut samples = String::new();
    io::stdin()
        .read_to_string(&mut samples)
        .expect("samples as text");
    for line in samples.lines() {
        let (index, sample) = line.split_once(' ').expect("an index");
        let index: usize = index.parse().expect("an index");
        let (data, parameters) = sample.split_once(';').expect("data and parameters");
        let (data, parameters) = (numbers(data), numbers(parameters));
        let answers: Vec<String> = variants
            .iter()
            .map(|variant| {
                let family = variant.instances[index].family;
                let mut prepared = vec![0.0; family.shape().prepared];
                family.prepare(&data, &mut prepared);
                let mut value = vec![0.0; family.shape().residuals];
                family.value(&prepared, &parameters, &mut value);
                let mut residuals = vec![0.0; family.shape().residuals];
                let mut jacobian = vec![0.0; family.pattern().columns.len()];
                family.linearize(&prepared, &parameters, &mut residuals, &mut jacobian);
                format!("{};{};{}", bits(&value), bits(&residuals), bits(&jacobian))
            })
            .collect();
        println!("{}", answers.join("|"));
    }
}
