//! Where a measurement comes from: what one has to know to cite it or to repeat it.

use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

/// Program, time and machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The program's version, and the commit that it was built from.
    pub version: String,
    /// When the report was made, as `2026-01-31T12:00:00Z`.
    pub date: String,
    /// The command line.
    pub command: String,
    /// Name of the system and its kernel's architecture.
    pub system: String,
    /// The processor, and how many of its threads the program may use.
    pub processor: String,
    /// Drivers of OpenCL and Vulkan with their versions.
    pub drivers: Vec<String>,
    /// Stands for scene, settings and devices: the folder below `parts` that holds what was measured.
    pub key: String,
}

impl Provenance {
    /// Of this run.
    pub fn now(drivers: Vec<String>, key: String) -> Provenance {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let words = std::env::args().skip(1);
        Provenance {
            version: crate::VERSION.to_string(),
            date: utc(seconds),
            command: std::iter::once("foveate".to_string()).chain(words).collect::<Vec<_>>().join(" "),
            system: system(),
            processor: processor(),
            drivers,
            key,
        }
    }

    /// Names and values, for a list.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        vec![
            ("version", format!("foveate {}", self.version)),
            ("date", self.date.clone()),
            ("command", self.command.clone()),
            ("system", self.system.clone()),
            ("processor", self.processor.clone()),
            ("drivers", self.drivers.join("; ")),
            ("key", self.key.clone()),
        ]
    }
}

/// A time as RFC 3339 in UTC, by the calendar of Hinnant's `civil_from_days`.
fn utc(seconds: u64) -> String {
    let (days, left) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", left / 3600, left / 60 % 60, left % 60)
}

fn system() -> String {
    let release = std::fs::read_to_string("/etc/os-release").unwrap_or_default();
    let name = release.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="));
    let name = name.map_or(std::env::consts::OS, |name| name.trim_matches('"'));
    format!("{name}, {}", std::env::consts::ARCH)
}

fn processor() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map_or("a processor".to_string(), |(_, name)| name.trim().to_string());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{name}, {threads} threads")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(utc(seconds), expected);
        }
    }
}
