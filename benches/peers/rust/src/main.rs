//! Times what `closure.py` generated, and how fast this machine multiplies and moves numbers.
//!
//! Usage: tau-peers [--machine] DATA. The format of DATA and of the answers is that of `samples::text` and
//! `Program` in the benchmark's own modules.

#[cfg(feature = "generated")]
mod generated;
mod machine;

use std::io::{BufRead, Write};
use std::time::Instant;

/// A contender: runs once and gives what it computed.
type Contender = (&'static str, Box<dyn FnMut()>, f64);

/// Calls of which a turn takes the fastest.
const CALLS: usize = 5;

fn main() {
    let mut arguments = std::env::args().skip(1).peekable();
    let mut contenders: Vec<Contender> = Vec::new();
    if arguments.next_if(|argument| argument == "--machine").is_some() {
        contenders.extend(machine::contenders());
    }
    let data = arguments.next().expect("a file of data");
    #[cfg(feature = "generated")]
    contenders.extend(generated::contenders(&data));
    let _ = data;
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
        writeln!(output).and_then(|()| output.flush()).expect("a listener");
    }
}
