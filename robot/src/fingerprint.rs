//! Fingerprints, to recognise a folder, a description or a measurement again: the 64-bit FNV-1a hash (Fowler, Noll, Vo),
//! which changes with any byte. It recognises, it does not protect.

/// Fingerprint of named texts.
pub fn fingerprint<'a>(texts: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let mut hash = OFFSET_BASIS;
    for (name, text) in texts {
        // A byte that is in no text keeps names and texts apart.
        for part in [name.as_bytes(), &[0xff], text.as_bytes(), &[0xff]] {
            hash = hashed(hash, part);
        }
    }
    format!("fnv1a64:{hash:016x}")
}

/// Fingerprint of a description by what stands in it, whatever its comments and line breaks.
pub fn of_description(text: &str) -> String {
    let lines = text.lines().map(|line| {
        let end = line.find("//").unwrap_or(line.len());
        line[..end].split_whitespace()
    });
    let words: Vec<&str> = lines.flatten().collect();
    fingerprint([("description", words.join(" ").as_str())])
}

/// Fingerprint of a measurement by its numbers, however they were written: twelve hexadecimal digits, so that of ten
/// thousand measurements two have the same in one case of five million.
pub fn of_numbers(numbers: impl IntoIterator<Item = f64>) -> String {
    let hash = (numbers.into_iter()).fold(OFFSET_BASIS, |hash, number| {
        hashed(hash, &number.to_bits().to_le_bytes())
    });
    // The high bits, folded on those that are left out.
    format!("{:012x}", (hash ^ (hash >> 48)) & 0xffff_ffff_ffff)
}

/// Hash of bytes.
pub fn hash(bytes: &[u8]) -> u64 {
    hashed(OFFSET_BASIS, bytes)
}

/// The hash of nothing.
const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;

fn hashed(hash: u64, bytes: &[u8]) -> u64 {
    (bytes.iter()).fold(hash, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_difference_is_another_fingerprint() {
        let all = [
            fingerprint([]),
            fingerprint([("a", "b")]),
            fingerprint([("a", "c")]),
            fingerprint([("ab", "")]),
            fingerprint([("a", ""), ("b", "")]),
        ];
        for (i, one) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|other| other != one));
        }
        // The published offset basis, which is the hash of nothing.
        assert_eq!(all[0], "fnv1a64:cbf29ce484222325");
    }

    #[test]
    fn numbers_near_each_other_have_fingerprints_of_their_own() {
        let all: std::collections::BTreeSet<String> = (0..100_000)
            .map(|k| of_numbers([0.5, f64::from(k) * 1e-7]))
            .collect();
        assert_eq!(all.len(), 100_000);
        assert!(all.iter().all(|own| own.len() == 12));
    }
}
