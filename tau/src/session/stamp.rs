//! The program and the day, for files that say where they come from.

use std::env;
use std::time::{SystemTime, UNIX_EPOCH};

/// Seconds since 1970 that stand for the clock, so that outputs can be reproduced
/// (<https://reproducible-builds.org/specs/source-date-epoch/>).
const OVERRIDE: &str = "SOURCE_DATE_EPOCH";

/// The program that writes a file, and the day.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stamp {
    /// Program and version.
    pub program: String,
    /// Day, `YYYY-MM-DD` in UTC.
    pub date: String,
}

impl Stamp {
    /// This program, today.
    pub(super) fn today() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        let now = since.map_or(0, |since| since.as_secs());
        Self {
            program: format!("tau {}", env!("CARGO_PKG_VERSION")),
            date: date(stated(env::var(OVERRIDE).ok().as_deref()).unwrap_or(now)),
        }
    }
}

/// The override, where it is a number.
fn stated(text: Option<&str>) -> Option<u64> {
    text?.trim().parse().ok()
}

/// The day of a second since 1970 in UTC, by counting years from March so that leap days come last.
fn date(seconds: u64) -> String {
    const DAYS_OF_400_YEARS: u64 = 146_097;
    // Days since 1 March 0000.
    let days = seconds / 86_400 + 719_468;
    let (era, day) = (days / DAYS_OF_400_YEARS, days % DAYS_OF_400_YEARS);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day_of_year = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (month, later) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    format!("{:04}-{month:02}-{day:02}", era * 400 + year + later)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01"),
            (951_782_399, "2000-02-28"),
            (951_782_400, "2000-02-29"),
            (951_868_800, "2000-03-01"),
            (1_735_689_599, "2024-12-31"),
            (4_107_542_400, "2100-03-01"),
        ] {
            assert_eq!(date(seconds), expected);
        }
        assert_eq!(
            stated(Some("951782400")).map(date).as_deref(),
            Some("2000-02-29")
        );
        assert_eq!((stated(None), stated(Some("yesterday"))), (None, None));
    }
}
