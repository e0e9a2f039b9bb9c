//! For which times poses were asked, beside those at which their pictures are seen: looked at in every test.

use fake_runtime::log::{Log, Record};
use serde_json::Value;

/// Frames after a wrong time by which the program asks for the right ones again.
const RECOVERY: u64 = 5;
/// Frames from which the program learns how long one takes.
const MEASURED: usize = 5;

/// A frame that was shown: its number, the moment of its display that the runtime told, the true one, the
/// display's period, and when it ended; then, for each time that poses were asked for, that and the moment of
/// asking. In nanoseconds.
#[derive(Debug)]
pub struct Shown {
    pub number: u64,
    pub told: i64,
    pub truth: i64,
    pub period: i64,
    pub ended: i64,
    pub asked: Vec<(i64, i64)>,
    /// The runtime has told the truth of this frame's time and of those before it.
    pub honest: bool,
}

impl Shown {
    /// How far the times asked for are from a moment, in periods.
    pub fn off(&self, from: i64) -> Vec<f64> {
        self.asked.iter().map(|(time, _)| (time - from) as f64 / self.period as f64).collect()
    }

    /// Whether it ended while it could still be shown when it was to be.
    pub fn in_time(&self) -> bool {
        self.ended < self.truth
    }

    /// When it is seen: at its time, or where that is past at its end, at the display's next beat.
    pub fn seen(&self) -> i64 {
        let late = (self.ended - self.truth).max(0);
        self.truth + (late + self.period - 1) / self.period * self.period
    }
}

fn int(value: &Value) -> i64 {
    value.as_i64().unwrap_or_default()
}

/// Whether the runtime told of a frame what is true, and no other period than for the one before.
fn is_honest(wait: &Record, before: Option<&&Record>) -> bool {
    let same = |a: &str, b: &str| wait.0[a] == wait.0[b];
    let steady = before.is_none_or(|before| before.0["true_period"] == wait.0["true_period"]);
    same("display_time", "true_display_time") && same("period", "true_period") && steady
}

/// All frames that new pictures were handed over for, in order.
pub fn shown(log: &Log) -> Vec<Shown> {
    let waits: Vec<&Record> =
        log.calls("xrWaitFrame").into_iter().filter(|w| w.0["frame"].is_u64()).collect();
    let (mut shown, mut asked) = (Vec::new(), Vec::new());
    for record in &log.0 {
        match record.call() {
            "xrBeginFrame" => asked.clear(),
            "xrLocateViews" if record.0["poses"].is_array() && record.result() == "SUCCESS" => {
                asked.push((int(&record.0["time"]), int(&record.0["ns"])));
            }
            "xrEndFrame" if record.result() == "SUCCESS" => {
                let layers = record.0["layers"].as_array().is_some_and(|layers| !layers.is_empty());
                // Of a picture that is held nothing is asked but where the views are as it begins.
                if layers && asked.len() > 1 {
                    shown.push(of_frame(record, &waits, std::mem::take(&mut asked)));
                }
            }
            _ => {}
        }
    }
    shown
}

/// A frame that was shown, by its end.
fn of_frame(end: &Record, waits: &[&Record], asked: Vec<(i64, i64)>) -> Shown {
    let own: Vec<&&Record> = waits.iter().filter(|wait| wait.0["on"] == end.0["on"]).collect();
    let number = end.0["frame"].as_u64().unwrap();
    let place = own.iter().position(|wait| wait.0["frame"] == end.0["frame"]).unwrap();
    let first = place.saturating_sub(RECOVERY as usize);
    let honest = (first..=place).all(|at| is_honest(own[at], at.checked_sub(1).map(|at| own[at])));
    let wait = own[place];
    Shown {
        number,
        told: int(&wait.0["display_time"]),
        truth: int(&wait.0["true_display_time"]),
        period: int(&wait.0["true_period"]),
        ended: int(&end.0["ns"]),
        asked,
        honest,
    }
}

/// What frames took, from their first asking to the next frame's: at least what the program has measured.
fn took(shown: &[Shown]) -> Vec<i64> {
    shown.windows(2).map(|pair| pair[1].asked[0].1 - pair[0].asked[0].1).collect()
}

/// The frames that ended in time, and that those before did not lead the program to expect late.
pub fn in_time(shown: &[Shown]) -> Vec<&Shown> {
    let took = took(shown);
    let foreseen = |index: usize| {
        let mut before = took[index.saturating_sub(MEASURED)..index].to_vec();
        before.sort_unstable();
        let usual = before.get(before.len() / 2).copied().unwrap_or(0);
        let frame = &shown[index];
        frame.asked.iter().all(|(_, when)| when + usual < frame.truth)
    };
    (0..shown.len()).filter(|&index| shown[index].in_time() && foreseen(index)).map(|i| &shown[i]).collect()
}

/// Poses are asked for the moment at which the frame is displayed, on the display's beat, and for a later one only
/// where frames have taken so long that it may be that one. Where the machine stands still between the end of
/// xrWaitFrame and the reading of a clock one frame is mistaken, so few are forgiven.
pub fn check(log: &Log) {
    let shown = shown(log);
    let took = took(&shown);
    let mut wrong = Vec::new();
    for (index, frame) in shown.iter().enumerate().filter(|(_, frame)| frame.honest) {
        let usual = took[index.saturating_sub(MEASURED)..index].iter().copied().max().unwrap_or(0);
        for &(time, when) in &frame.asked {
            let latest = frame.truth.max(when + usual) + 2 * frame.period;
            let off_beat = (time - frame.truth) % frame.period;
            if time < frame.truth {
                wrong.push(format!("asked for a moment before the display: {frame:?}"));
            } else if time > latest {
                wrong.push(format!("asked for {} ns too late: {frame:?}", time - latest));
            } else if when <= frame.truth && off_beat != 0 {
                wrong.push(format!("asked for {off_beat} ns after a beat: {frame:?}"));
            } else {
                continue;
            }
            break;
        }
    }
    assert!(wrong.len() <= 1 + shown.len() / 20, "{wrong:#?}");
}

/// Tests read logs that are being written.
#[test]
fn a_line_that_is_not_whole_yet_is_left_out() {
    let file = tempfile::NamedTempFile::new().unwrap();
    for (text, whole) in
        [("", 0), ("{\"ca", 0), ("{\"call\":\"a\"}\n", 1), ("{\"call\":\"a\"}\n{\"call\":\"b\"", 1)]
    {
        std::fs::write(file.path(), text).unwrap();
        assert_eq!(Log::read(file.path()).0.len(), whole, "{text}");
    }
}

/// Poses asked for long after the display, and before it, are found.
#[test]
fn wrong_times_are_found() {
    let frames = |asked: i64| {
        let mut lines = Vec::new();
        for frame in 1..8 {
            let (now, display) = (frame * 10_000, frame * 10_000 + 10_000);
            let mut call = |call: &str, ns: i64, more: Value| {
                let mut record = serde_json::json!({ "call": call, "ns": ns, "result": "SUCCESS", "on": 7 });
                record.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
                lines.push(Record(record));
            };
            call(
                "xrWaitFrame",
                now,
                serde_json::json!({ "frame": frame, "display_time": display, "true_display_time": display,
                    "period": 10_000, "true_period": 10_000 }),
            );
            call("xrBeginFrame", now, serde_json::json!({}));
            for step in 0..4 {
                let time = display + if frame > 4 { asked } else { 0 };
                call("xrLocateViews", now + step * 1000, serde_json::json!({ "time": time, "poses": [] }));
            }
            call("xrEndFrame", now + 5000, serde_json::json!({ "frame": frame, "layers": [1] }));
        }
        Log(lines)
    };
    check(&frames(0));
    check(&frames(10_000));
    for wrong in [-10_000, 3_333, 60_000] {
        assert!(std::panic::catch_unwind(|| check(&frames(wrong))).is_err(), "{wrong} is taken");
    }
}
