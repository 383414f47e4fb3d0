//! Fingerprints of texts, to recognise a measurement folder or a description again.

/// Fingerprint of named texts: 64 bits of the FNV-1a hash (Fowler, Noll, Vo), which changes with any byte of them. It
/// recognises, it does not protect.
pub fn fingerprint<'a>(texts: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        for &byte in bytes {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    for (name, text) in texts {
        // A byte that is in no text keeps names and texts apart.
        for part in [name.as_bytes(), &[0xff], text.as_bytes(), &[0xff]] {
            add(part);
        }
    }
    format!("fnv1a64:{hash:016x}")
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
}
