//! Commands for a reader to copy into a shell.

use std::path::MAIN_SEPARATOR;

/// A word of a command line as a shell reads it back.
pub fn shell_word(word: &str) -> String {
    let is_plain = |letter: char| {
        letter.is_alphanumeric() || letter == MAIN_SEPARATOR || "_-./:,=+@%".contains(letter)
    };
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
