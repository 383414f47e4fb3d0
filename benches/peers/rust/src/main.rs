//! Times what `closure.py` generated, and how fast this machine multiplies and moves numbers.
//!
//! Usage: tau-peers [--machine] DATA. The format of DATA and of the answers is that of `samples::text` and
//! `Program` in the benchmark's own modules.

mod answers;
#[cfg(feature = "generated")]
mod generated;
mod machine;

use answers::{Contender, answer};

fn main() {
    let mut arguments = std::env::args().skip(1).peekable();
    let mut contenders: Vec<Contender> = Vec::new();
    if arguments
        .next_if(|argument| argument == "--machine")
        .is_some()
    {
        contenders.extend(machine::contenders());
    }
    let data = arguments.next().expect("a file of data");
    #[cfg(feature = "generated")]
    contenders.extend(generated::contenders(&data));
    let _ = data;
    answer(contenders);
}
