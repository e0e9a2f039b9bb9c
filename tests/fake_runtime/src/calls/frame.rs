//! The frame loop.

use std::path::Path;
use std::time::Duration;

use openxr_sys::{self as xr, Handle};
use serde_json::{Value, json};

use super::layer::Shown;
use crate::abi::{In, Out};
use crate::log::Note;
use crate::nested::{self, Layer};
use crate::order::Frame;
use crate::refusal::{Outcome, Refusal, out_of_order, wrong};
use crate::runtime::{BEGUN, On, Runtime, enter, hang, lock, now};
use crate::script::{FrameRule, When, within};

const DONE: Outcome = Ok(xr::Result::SUCCESS);

/// An application that waits this long for itself has locked itself out.
const DEADLOCK: Duration = Duration::from_secs(20);

/// The one call that takes its time, and lets others in meanwhile.
pub(crate) fn wait(
    session: xr::Session,
    info: In<xr::FrameWaitInfo>,
    state: Out<xr::FrameState>,
) -> xr::Result {
    const CALL: &str = "xrWaitFrame";
    let handle = session.into_raw();
    let mut note = Note::default();
    hang(CALL);
    let mut runtime = lock();
    let admitted = runtime.admit(CALL, On::Session(session), &mut note);
    if let Err(refusal) = admitted.and_then(|()| info.optional()) {
        return runtime.finish(CALL, Err(refusal), note);
    }
    // A second xrWaitFrame blocks until the first one's frame is begun.
    let blocked = |runtime: &mut Runtime| runtime.running(handle).is_ok_and(|s| s.frames.must_block());
    let (mut runtime, timeout) = match BEGUN.wait_timeout_while(runtime, DEADLOCK, |r| blocked(r)) {
        Ok(waited) => waited,
        Err(poisoned) => poisoned.into_inner(),
    };
    if timeout.timed_out() {
        let refusal = out_of_order("xrWaitFrame twice without xrBeginFrame between them: a deadlock");
        return runtime.finish(CALL, Err(refusal), note);
    }
    let due = match runtime.due(handle) {
        Ok(due) => due,
        Err(refusal) => return runtime.finish(CALL, Err(refusal), note),
    };
    drop(runtime);
    std::thread::sleep(Duration::from_nanos((due - now()).max(0) as u64));
    let mut runtime = lock();
    let outcome = runtime.frame(handle, due, &mut note).and_then(|(frame, period)| {
        state.write(|next| xr::FrameState {
            ty: xr::FrameState::TYPE,
            next,
            predicted_display_time: xr::Time::from_nanos(frame.display_time),
            predicted_display_period: xr::Duration::from_nanos(period),
            should_render: frame.should_render.into(),
        })?;
        DONE
    });
    runtime.finish(CALL, outcome, note)
}

pub(crate) fn begin(session: xr::Session, info: In<xr::FrameBeginInfo>) -> xr::Result {
    enter("xrBeginFrame", On::Session(session), |runtime, _| {
        info.optional()?;
        let discarded = runtime.running(session.into_raw())?.frames.begin()?;
        BEGUN.notify_all();
        Ok(if discarded { xr::Result::FRAME_DISCARDED } else { xr::Result::SUCCESS })
    })
}

pub(crate) fn end(session: xr::Session, info: In<xr::FrameEndInfo>) -> xr::Result {
    enter("xrEndFrame", On::Session(session), |runtime, note| {
        let info = info.get()?;
        let handle = session.into_raw();
        let time = info.display_time.as_nanos();
        note.set("display_time", time);
        let frame = runtime.running(handle)?.frames.end(time)?;
        note.set("frame", frame.number);
        note.set("should_render", frame.should_render);
        if info.environment_blend_mode != xr::EnvironmentBlendMode::OPAQUE {
            return Err(wrong(
                xr::Result::ERROR_ENVIRONMENT_BLEND_MODE_UNSUPPORTED,
                "only the opaque blend mode is there",
            ));
        }
        let mut layers = Vec::new();
        let mut parts = Vec::new();
        for layer in nested::layers(info) {
            layers.push(match layer {
                Layer::Projection(layer) => runtime.projection(handle, layer, &mut parts)?,
                Layer::Quad(layer) => runtime.quad(handle, layer, &mut parts)?,
                Layer::Other(ty) => {
                    return Err(wrong(xr::Result::ERROR_LAYER_INVALID, format!("a layer of type {ty:?}")));
                }
            });
        }
        note.set("layers", layers);
        let session = runtime.session(handle)?;
        session.frames.ended();
        session.ended_frames += 1;
        let number = session.ended_frames;
        let dump = session.script.dumps.iter().find(|dump| dump.frame == number).cloned();
        if let Some(dump) = dump {
            note.set("dumped", runtime.dump(handle, &parts, &dump.folder)?);
        }
        DONE
    })
}

impl Runtime {
    /// When xrWaitFrame returns: at the next beat of the display, and later if the script says so.
    fn due(&mut self, handle: u64) -> Result<i64, Refusal> {
        let usual = self.script.period_ms;
        let session = self.running(handle)?;
        let number = session.latest.number + 1;
        let period = period(&session.script.frames, number, usual);
        let late = rules(&session.script.frames, number).map(|rule| rule.wait_ms).sum::<u64>();
        if rules(&session.script.frames, number).any(|rule| rule.at_once) {
            return Ok(now());
        }
        let next = session.last_display.max(session.created) + period;
        Ok(next.max(now()) + late as i64 * 1_000_000)
    }

    /// Decides about the next frame; the period goes with it.
    fn frame(&mut self, handle: u64, due: i64, note: &mut Note) -> Result<(Frame, i64), Refusal> {
        let usual = self.script.period_ms;
        let session = self.running(handle)?;
        session.last_display = due;
        let number = session.latest.number + 1;
        let period = period(&session.script.frames, number, usual);
        note.set("true_display_time", due + period);
        note.set("true_period", period);
        let mut frame =
            Frame { number, display_time: due + period, should_render: session.state.is_visible() };
        let mut told_period = period;
        for rule in rules(&session.script.frames, number) {
            frame.display_time += (rule.offset_ms * 1e6) as i64;
            frame.display_time = rule.display_time.unwrap_or(frame.display_time);
            frame.should_render = rule.should_render.unwrap_or(frame.should_render);
            told_period = rule.display_period.unwrap_or(told_period);
        }
        session.latest = frame;
        session.frames.wait(frame);
        note.set("frame", number);
        note.set("display_time", frame.display_time);
        note.set("period", told_period);
        note.set("should_render", frame.should_render);
        note.set("gaze", crate::world::gaze(&self.script.gaze, number).map(|pose| pose.list()));
        self.step(handle, When::Frame(number))?;
        self.tell_events(handle, number)?;
        Ok((frame, told_period))
    }

    /// Writes the sub-images of a frame into a folder.
    fn dump(&mut self, session: u64, parts: &[Shown], folder: &Path) -> Result<Vec<Value>, Refusal> {
        let io = |error: std::io::Error| panic!("{}: {error}", folder.display());
        std::fs::create_dir_all(folder).unwrap_or_else(io);
        let mut written = Vec::new();
        for Shown { name, swapchain, part } in parts {
            let bytes = self.read(session, *swapchain, *part)?;
            let path = folder.join(format!("{name}.raw"));
            std::fs::write(&path, bytes).unwrap_or_else(io);
            let format = self.swapchain(*swapchain)?.shape.format.as_raw();
            written.push(json!({
                "path": path, "width": part.width, "height": part.height, "format": format,
            }));
        }
        Ok(written)
    }
}

/// The rules for a frame.
pub(super) fn rules(rules: &[FrameRule], number: u64) -> impl Iterator<Item = &FrameRule> {
    rules.iter().filter(move |rule| within(number, rule.from, rule.to))
}

/// Nanoseconds between two pictures of the display at a frame.
fn period(frames: &[FrameRule], number: u64, usual_ms: f64) -> i64 {
    let scripted = rules(frames, number).filter_map(|rule| rule.period_ms).last();
    (scripted.unwrap_or(usual_ms) * 1e6) as i64
}
