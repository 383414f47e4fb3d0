//! Parts common to the peers' programs: data to compute on, and turns with the benchmark.

use std::io::{BufRead, Write};
use std::time::Instant;

/// A contender: runs once and gives what it computed.
pub(crate) type Contender = (&'static str, Box<dyn FnMut()>, f64);

/// Calls of which a turn takes the fastest.
const CALLS: usize = 5;

/// Samples, parameters and results to agree with.
#[allow(
    dead_code,
    reason = "without generated code only the machine is measured"
)]
pub(crate) struct Data {
    pub(crate) parameters: [f64; 10],
    pub(crate) samples: Vec<[f64; 7]>,
    /// Residual and derivatives of each.
    pub(crate) reference: Vec<[f64; 11]>,
}

#[allow(
    dead_code,
    reason = "without generated code only the machine is measured"
)]
impl Data {
    /// In the format of `samples::text` in the benchmark's own modules.
    pub(crate) fn read(path: &str) -> Self {
        let text = std::fs::read_to_string(path).expect("the data");
        let mut numbers = text
            .split_whitespace()
            .map(|n| n.parse().expect("a number"));
        let mut next = || numbers.next().expect("more numbers");
        let count: f64 = next();
        let parameters = std::array::from_fn(|_| next());
        let (mut samples, mut reference) = (Vec::new(), Vec::new());
        for _ in 0..count as usize {
            samples.push(std::array::from_fn(|_| next()));
            reference.push(std::array::from_fn(|_| next()));
        }
        Self {
            parameters,
            samples,
            reference,
        }
    }
}

/// A turn for each line on standard input, answered as `Program` in the benchmark's own modules reads it.
pub(crate) fn answer(mut contenders: Vec<Contender>) {
    let mut output = std::io::stdout().lock();
    for _ in std::io::stdin().lock().lines().map_while(Result::ok) {
        for (name, run, result) in &mut contenders {
            let least = (0..CALLS)
                .map(|_| {
                    let started = Instant::now();
                    run();
                    started.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min);
            writeln!(output, "{name}\t{least:e}\t{result:e}").expect("a listener");
        }
        writeln!(output)
            .and_then(|()| output.flush())
            .expect("a listener");
    }
}
