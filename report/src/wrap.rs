//! Sentences in lines of the terminal's width.

/// Widest line.
pub(crate) const WIDTH: usize = 100;

/// Breaks a sentence into lines.
pub(crate) fn wrap(sentence: &str, indent: &str) -> String {
    let mut text = String::new();
    let mut line = indent.to_owned();
    for word in sentence.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > WIDTH && line.len() > indent.len() {
            text += line.trim_end();
            text.push('\n');
            indent.clone_into(&mut line);
        }
        line += word;
        line.push(' ');
    }
    text += line.trim_end();
    text.push('\n');
    text
}
