//! Statements as lines.
//!
//! Bodies of functions are nearly all of generated code and simple, so that laying them out takes no syntax
//! tree: the formatter sees the items around them alone. The macro reads the same text as tokens; a test holds a
//! file's tokens against the expansion.

/// Characters in a line.
pub(super) const WIDTH: usize = 100;

/// A formatted text with each line that is `mark` replaced by the statements of a body.
pub(super) fn with_bodies(text: &str, mark: &str, bodies: Vec<Vec<String>>) -> String {
    let mut bodies = bodies.into_iter();
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.trim_start() != mark {
            lines.push(line.to_owned());
            continue;
        }
        let indent = line.len() - mark.len();
        for statement in bodies.next().into_iter().flatten() {
            push(&mut lines, &statement, indent);
        }
    }
    lines.push(String::new());
    lines.join("\n")
}

/// Adds a statement, broken where it is too long.
fn push(lines: &mut Vec<String>, statement: &str, indent: usize) {
    let mut rest = statement;
    let mut indent = indent;
    let further = indent + 4;
    while indent + rest.len() > WIDTH
        && let Some(at) = place_to_break(rest, WIDTH - indent)
    {
        lines.push(format!("{:indent$}{}", "", &rest[..at]));
        rest = &rest[at + 1..];
        indent = further;
    }
    lines.push(format!("{:indent$}{rest}", ""));
}

/// The space at which a line that is longer than `width` ends: as far out of parentheses as can be, there
/// rather between terms than between factors, and the last of those.
fn place_to_break(line: &str, width: usize) -> Option<usize> {
    let mut best: Option<((usize, u8), usize)> = None;
    let mut depth = 0_usize;
    let bytes = line.as_bytes();
    for (at, &byte) in bytes.iter().enumerate().take(width + 1) {
        match byte {
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            b' ' => {
                if let Some(tightness) = tightness(bytes, at)
                    && best.is_none_or(|(least, _)| (depth, tightness) <= least)
                {
                    best = Some(((depth, tightness), at));
                }
            }
            _ => {}
        }
    }
    best.map(|(_, at)| at)
}

/// Strength of the bond at either side of a space; `None` where no line may end.
fn tightness(bytes: &[u8], at: usize) -> Option<u8> {
    let before = at.checked_sub(1).and_then(|before| bytes.get(before));
    let is_operator = bytes.get(at + 2) == Some(&b' ');
    match (before, bytes.get(at + 1)) {
        (Some(b','), _) => Some(0),
        (_, Some(b'+' | b'-')) if is_operator => Some(0),
        (_, Some(b'*' | b'/')) if is_operator => Some(1),
        (Some(b'='), _) => Some(2),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn laid_out(statement: &str) -> Vec<String> {
        let mut lines = Vec::new();
        push(&mut lines, statement, 12);
        lines
    }

    #[test]
    fn a_short_statement_is_one_line() {
        assert_eq!(laid_out("let t1 = a * b;"), ["            let t1 = a * b;"]);
    }

    #[test]
    fn a_long_sum_breaks_between_its_terms() {
        let term = "first_factor_of_a_product * (second_factor - third_factor)";
        let statement = format!("let t1 = {term} + {term} - {term};");
        let lines = laid_out(&statement);
        assert!(lines.iter().all(|line| line.len() <= WIDTH), "{lines:?}");
        assert!(lines[1].starts_with("                + first"), "{lines:?}");
        assert!(lines[2].starts_with("                - first"), "{lines:?}");
        let words: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
        assert_eq!(words.join(" "), statement);
    }

    #[test]
    fn terms_are_parted_before_factors() {
        let factors = "one_of_three * (another_one - what_it_is_less) * the_third";
        let statement = format!("jacobian[3][lane] = {factors} + {factors};");
        let lines = laid_out(&statement);
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(lines[1].trim().starts_with("+ one"), "{lines:?}");
    }

    #[test]
    fn what_is_only_in_parentheses_breaks_there() {
        let names: Vec<String> = (0..20).map(|k| format!("parameter_{k}")).collect();
        let statement = format!("let t1 = math::sin({});", names.join(" + "));
        let lines = laid_out(&statement);
        assert!(lines.len() > 2);
        assert!(lines.iter().all(|line| line.len() <= WIDTH), "{lines:?}");
        let words: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
        assert_eq!(words.join(" "), statement);
    }
}
