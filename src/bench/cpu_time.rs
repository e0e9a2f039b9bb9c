//! The time that processors spent on this program: where others use them too, it says more than a clock.

use std::fs;

/// Nanoseconds that all running threads of this program have spent on processors so far; `None` where
/// the system does not tell.
pub fn of_all_threads() -> Option<u64> {
    let threads = fs::read_dir("/proc/self/task").ok()?;
    // A thread that ends between listing and reading is left out.
    let texts = threads.flatten().filter_map(|t| fs::read_to_string(t.path().join("schedstat")).ok());
    texts
        .map(|text| text.split_whitespace().next()?.parse::<u64>().ok())
        .sum::<Option<u64>>()
        .filter(|&t| t > 0)
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    #[test]
    fn work_takes_time() {
        let Some(before) = super::of_all_threads() else {
            println!("not run: this system does not tell how long threads ran");
            return;
        };
        let start = Instant::now();
        while start.elapsed() < Duration::from_millis(50) {
            std::hint::black_box(start);
        }
        assert!(super::of_all_threads().unwrap() > before);
    }
}
