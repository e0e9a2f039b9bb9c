//! Time: the tracker's 16-bit millisecond counter unwrapped, and mapped to the host's clock.

use std::collections::VecDeque;

/// Milliseconds after which the device's counter starts again.
const TURN: u64 = 1 << 16;
/// A report that starts up to this many ms before the expected time repeats one already seen.
const OVERLAP: u64 = 256;
/// Host seconds of silence from which the device's counter may have gone round unseen.
const SILENCE: f64 = 60.0;
/// Turns that one silence may add: two years.
const MAX_TURNS: f64 = 1e6;

/// What a report's timestamp says about the reports before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// The first report of all.
    First,
    /// It follows the one before without a hole.
    Unbroken,
    /// This many ms of samples are missing before it.
    Lost(u64),
    /// It stands for time that is already covered, and must not be integrated.
    Repeated,
    /// The device was opened anew: this many ms passed, as far as is known.
    Restarted(u64),
}

/// A report's place in unwrapped device time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placement {
    /// Time of its first sample in ms.
    pub first_ms: u64,
    /// Time of its newest sample in ms.
    pub newest_ms: u64,
    /// What came before.
    pub continuity: Continuity,
}

impl Placement {
    /// Time of the newest sample in seconds.
    pub fn seconds(&self) -> f64 {
        self.newest_ms as f64 * 1e-3
    }
}

/// Unwraps timestamps by the law that an unbroken stream's timestamps differ by the sample count.
#[derive(Clone, Debug, Default)]
pub struct DeviceClock {
    expected: Option<u64>,
    /// Time of the newest sample so far in ms: a report without samples may be the newest.
    newest: u64,
    heard: Option<f64>,
    restarted: bool,
}

impl DeviceClock {
    /// Takes up a report with `timestamp` that stands for `count` samples.
    ///
    /// `host` is its arrival in seconds, where known: it alone can tell a silence longer than the
    /// counter's turn from a short one. A hole belongs to the time before the report, because
    /// the timestamp is that of its first sample.
    pub fn place(&mut self, timestamp: u16, count: u8, host: Option<f64>) -> Placement {
        let silence = self.heard.zip(host).map_or(0.0, |(before, now)| now - before);
        if host.is_some() {
            self.heard = host;
        }
        let Some(expected) = self.expected else {
            return self.accept(u64::from(timestamp), count, Continuity::First);
        };
        let gap = u64::from(timestamp.wrapping_sub((expected % TURN) as u16));
        let turns = unseen_turns(silence, gap);
        if std::mem::take(&mut self.restarted) {
            let gap = gap + turns * TURN;
            return self.accept(expected + gap, count, Continuity::Restarted(gap));
        }
        if gap > TURN - OVERLAP && turns == 0 {
            let first_ms = (expected + gap).saturating_sub(TURN);
            let newest_ms = self.newest;
            return Placement { first_ms, newest_ms, continuity: Continuity::Repeated };
        }
        let gap = gap + turns * TURN;
        let continuity = if gap == 0 { Continuity::Unbroken } else { Continuity::Lost(gap) };
        self.accept(expected + gap, count, continuity)
    }

    /// Says that the device was opened anew: its counter may stand anywhere.
    pub fn restart(&mut self) {
        self.restarted = self.expected.is_some();
    }

    fn accept(&mut self, first_ms: u64, count: u8, continuity: Continuity) -> Placement {
        let end = first_ms + u64::from(count);
        self.expected = Some(end);
        self.newest = end.saturating_sub(1).max(first_ms);
        Placement { first_ms, newest_ms: self.newest, continuity }
    }
}

/// Whole turns of the counter in `silence` host seconds beyond `gap` ms.
fn unseen_turns(silence: f64, gap: u64) -> u64 {
    if silence < SILENCE {
        return 0;
    }
    ((silence * 1e3 - gap as f64) / TURN as f64).round().clamp(0.0, MAX_TURNS) as u64
}

/// Seconds of one window of [`HostClock`].
const WINDOW: f64 = 0.5;
/// Windows that are kept: one minute.
const WINDOWS: usize = 120;
/// Seconds that must be covered before a drift is estimated.
const DRIFT_SPAN: f64 = 2.0;
/// The greatest believable drift. The timestamps count the MPU-6000's samples, whose own clock is
/// specified to one per cent.
const MAX_DRIFT: f64 = 0.02;
/// A jump of the clocks against each other, in seconds, after which the mapping starts again.
const JUMP: f64 = 0.1;
/// Late windows in a row that show the device's clock to have paused.
const LATE_WINDOWS: u32 = 4;

#[derive(Clone, Copy, Debug)]
struct Observation {
    device: f64,
    offset: f64,
}

/// Maps device time to host time, in seconds, by the reports that arrived with the least delay.
///
/// A report is never early and sometimes late, so the mapping is the line under the points
/// (device time, host minus device time) that comes nearest to them: an edge of their lower convex
/// hull. What remains unknown is the least delay itself, about a millisecond of USB.
#[derive(Clone, Debug, Default)]
pub struct HostClock {
    minima: VecDeque<Observation>,
    offset: f64,
    drift: f64,
    anchor: f64,
    window_end: f64,
    late: u32,
}

impl HostClock {
    /// Takes up that the report whose newest sample is of `device` arrived at `host`.
    pub fn observe(&mut self, device: f64, host: f64) {
        if !(device.is_finite() && host.is_finite()) {
            return;
        }
        let point = Observation { device, offset: host - device };
        let above = point.offset - self.offset_at(device);
        if self.minima.is_empty() || above < -JUMP || self.late > LATE_WINDOWS {
            *self = HostClock {
                offset: point.offset,
                anchor: device,
                window_end: device + WINDOW,
                ..Self::default()
            };
            self.minima.push_back(point);
            return;
        }
        if device >= self.window_end {
            self.close_window();
            self.window_end = device + WINDOW;
            self.minima.push_back(point);
            return;
        }
        if let Some(least) = self.minima.back_mut()
            && above < least.offset - (self.offset + self.drift * (least.device - self.anchor))
        {
            *least = point;
        }
    }

    /// The host time of a device time; `None` before the first report.
    pub fn host(&self, device: f64) -> Option<f64> {
        (!self.minima.is_empty()).then(|| device + self.offset_at(device))
    }

    /// Host seconds per device second, less one.
    pub fn drift(&self) -> f64 {
        self.drift
    }

    fn offset_at(&self, device: f64) -> f64 {
        self.offset + self.drift * (device - self.anchor)
    }

    fn close_window(&mut self) {
        let lateness = self.minima.back().map_or(0.0, |least| least.offset - self.offset_at(least.device));
        self.late = if lateness > JUMP { self.late + 1 } else { 0 };
        while self.minima.len() >= WINDOWS {
            self.minima.pop_front();
        }
        self.fit();
    }

    fn fit(&mut self) {
        let (Some(first), Some(last)) = (self.minima.front(), self.minima.back()) else { return };
        let middle = 0.5 * (first.device + last.device);
        let span = last.device - first.device;
        let (below, above) = hull_edge(&self.minima, middle);
        let run = above.device - below.device;
        let slope = if span < DRIFT_SPAN || run <= 0.0 { 0.0 } else { (above.offset - below.offset) / run };
        self.drift = slope.clamp(-MAX_DRIFT, MAX_DRIFT);
        self.anchor = below.device;
        self.offset = if span < DRIFT_SPAN { below.offset.min(above.offset) } else { below.offset };
    }
}

/// The edge of the lower convex hull of points in order of time that lies at `middle`.
fn hull_edge(points: &VecDeque<Observation>, middle: f64) -> (Observation, Observation) {
    let mut hull: Vec<Observation> = Vec::with_capacity(points.len());
    for &point in points {
        while let [.., a, b] = hull[..]
            && (b.offset - a.offset) * (point.device - a.device)
                >= (point.offset - a.offset) * (b.device - a.device)
        {
            hull.pop();
        }
        hull.push(point);
    }
    let right = hull.partition_point(|point| point.device < middle).clamp(1, hull.len().max(2) - 1);
    let right = right.min(hull.len() - 1);
    (hull[right.saturating_sub(1)], hull[right])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timestamps_unwrap_and_holes_come_before_the_report() {
        let mut clock = DeviceClock::default();
        assert_eq!(clock.place(65_530, 4, None).continuity, Continuity::First);
        let next = clock.place(65_534, 2, None);
        assert_eq!((next.first_ms, next.newest_ms, next.continuity), (65_534, 65_535, Continuity::Unbroken));
        let wrapped = clock.place(0, 2, None);
        assert_eq!((wrapped.first_ms, wrapped.continuity), (65_536, Continuity::Unbroken));
        let after_hole = clock.place(12, 3, None);
        assert_eq!((after_hole.first_ms, after_hole.newest_ms), (65_548, 65_550));
        assert_eq!(after_hole.continuity, Continuity::Lost(10));
    }

    #[test]
    fn a_repeated_report_takes_no_time() {
        let mut clock = DeviceClock::default();
        clock.place(100, 40, None);
        let again = clock.place(100, 40, None);
        assert_eq!((again.newest_ms, again.continuity), (139, Continuity::Repeated));
        assert_eq!(clock.place(140, 2, None).continuity, Continuity::Unbroken);
    }

    #[test]
    fn a_long_silence_is_measured_by_the_host() {
        let mut clock = DeviceClock::default();
        clock.place(0, 2, Some(0.0));
        let late = clock.place(2, 2, Some(131.074));
        assert_eq!(late.continuity, Continuity::Lost(2 * TURN));
        clock.restart();
        assert_eq!(clock.place(4, 2, Some(132.0)).continuity, Continuity::Restarted(0));
    }

    #[test]
    fn mapping_finds_offset_and_drift_under_jitter_and_stalls() {
        let mut clock = HostClock::default();
        let mut state = 1_u32;
        let truth = |device: f64| 12.5 + device * 1.004;
        for step in 0..60_000_u32 {
            let device = f64::from(step) * 2e-3;
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let jitter = f64::from(state >> 8) / f64::from(1 << 24) * 2e-3;
            let stall = if step % 5_000 < 150 { 0.3 - f64::from(step % 5_000) * 2e-3 } else { 0.0 };
            clock.observe(device, truth(device) + jitter + stall);
            if device > 10.0 {
                let error = clock.host(device).unwrap() - truth(device);
                assert!(error.abs() < 1e-3, "{error} at {device}");
            }
        }
        assert!((clock.drift() - 0.004).abs() < 2e-5, "{}", clock.drift());
    }

    #[test]
    fn a_pause_of_the_device_starts_the_mapping_again() {
        let mut clock = HostClock::default();
        for step in 0..10_000_u32 {
            let device = f64::from(step) * 2e-3;
            clock.observe(device, device + if step < 4_000 { 0.0 } else { 5.0 });
        }
        assert!((clock.host(20.0).unwrap() - 25.0).abs() < 1e-3);
    }
}
