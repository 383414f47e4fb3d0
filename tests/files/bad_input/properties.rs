//! No text panics the readers, and what is written reads back.

use std::fmt::Write as _;

use tau::measurements::{Split, Texts};
use tau_testkit::Random;

use super::*;
use crate::mutations::broken;

/// A robot file with all that one can hold, as it is written; `"a name"` stands for any.
const ALL_SECTIONS: &str = include_str!("all_sections.toml");

/// An error can be shown, and points into its text.
fn check_error(error: &InputError, text: &str) {
    assert!(!error.problems().is_empty());
    assert!(!error.render(false).is_empty() && !error.render(true).is_empty());
    let places = error.problems().iter().filter_map(|own| own.place.as_ref());
    for place in places {
        assert!(place.span.end <= text.len() && place.line >= 1 && place.column >= 1);
    }
}

/// A quoted name of random characters, written with escapes.
fn name(random: &mut Random) -> String {
    let mut name = "\"".to_owned();
    for _ in 0..random.below(8) {
        let most = [0x80, 0x400, 0x11_0000][random.below(3)];
        let number = u32::try_from(random.below(most)).unwrap();
        let c = char::from_u32(number).unwrap_or('"');
        write!(name, "\\U{:08X}", u32::from(c)).unwrap();
    }
    name + "\""
}

/// The file with other names, and each line's fractions multiplied by a number between a half and 1.
fn varied(random: &mut Random) -> String {
    let mut text = String::new();
    for line in ALL_SECTIONS.lines() {
        let factor = 0.5 + 0.5 * random.uniform();
        let line = line.replace("\"a name\"", &name(random));
        for token in line.split_inclusive([' ', ',', ']', '[']) {
            let number = token.trim_end_matches([' ', ',', ']', '[']);
            match number.parse::<f64>() {
                Ok(value) if number.contains(['.', 'e']) => {
                    let end = &token[number.len()..];
                    write!(text, "{:?}{end}", factor * value).unwrap();
                }
                _ => text.push_str(token),
            }
        }
        text.push('\n');
    }
    text
}

fn parsed(text: &str) -> RobotFile {
    RobotFile::parse(text, "robot.toml").unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn what_is_written_reads_back_bit_for_bit() {
    assert_eq!(parsed(ALL_SECTIONS).to_toml(), ALL_SECTIONS);
    for seed in 0..50 {
        let mut file = parsed(&varied(&mut Random(seed)));
        let text = file.to_toml();
        let read = parsed(&text);
        file.source = read.source.clone();
        assert_eq!(read, file, "{text}");
        assert_eq!(read.to_toml(), text);
    }
}

#[test]
fn broken_files_never_panic_a_reader() {
    let mut random = Random(1);
    for _ in 0..100 {
        for (_, text) in &SETS[..3] {
            let bytes = broken(text.as_bytes(), true, &mut random);
            let text = String::from_utf8_lossy(&bytes);
            let all = Texts::of(|_| Some(&*text));
            let read = Folder::from_texts("folder", all, &Shape::of_carts(2));
            check_error(&read.unwrap_err(), &text);
        }
        let bytes = broken(ROBOT.as_bytes(), false, &mut random);
        let text = String::from_utf8_lossy(&bytes);
        match RobotFile::parse_for(&text, "robot.toml", &pair()) {
            Ok(file) => assert_eq!(RobotFile::parse(&file.to_toml(), "again").unwrap(), file),
            Err(error) => check_error(&error, &text),
        }
        let split = ["first", "fraction", "all", ""][random.below(4)];
        let split = format!("{split}:{}", &name(&mut random).replace("\\U", ":"));
        if let Err(error) = split.parse::<Split>() {
            check_error(&error, &split);
        }
    }
}

#[test]
fn any_bytes_are_answered() {
    let mut random = Random(2);
    for _ in 0..100 {
        let length = random.below(400);
        let bytes: Vec<u8> = (0..length)
            .map(|_| random.bits().to_le_bytes()[0])
            .collect();
        let work = with(TCP, &bytes);
        work.write("measured/robot.toml", &bytes);
        let text = String::from_utf8_lossy(&bytes);
        check_error(&read(&work).unwrap_err(), &text);
        check_error(&read_robot(&work).unwrap_err(), &text);
    }
}
