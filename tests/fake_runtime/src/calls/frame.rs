//! The frame loop.

use std::path::Path;
use std::time::Duration;

use openxr_sys::{self as xr, Handle};
use serde_json::{Value, json};

use crate::abi::{self, In, Out};
use crate::check::{check_fov, check_pose};
use crate::log::Note;
use crate::nested;
use crate::order::Frame;
use crate::refusal::{Outcome, Refusal, invalid, out_of_order, wrong};
use crate::runtime::{BEGUN, On, Runtime, enter, hang, lock, now};
use crate::script::{FrameRule, When, within};
use crate::vulkan::Part;

const DONE: Outcome = Ok(xr::Result::SUCCESS);

/// What a layer shows of a swapchain: a view's picture or its depths.
struct Shown {
    name: String,
    swapchain: u64,
    part: Part,
}

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
            match layer {
                Ok(layer) => layers.push(runtime.projection(handle, layer, &mut parts)?),
                Err(ty) => {
                    return Err(wrong(xr::Result::ERROR_LAYER_INVALID, format!("a layer of type {ty:?}")));
                }
            }
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

    /// Checks a projection layer and describes it for the log.
    fn projection(
        &mut self,
        session: u64,
        layer: &xr::CompositionLayerProjection,
        parts: &mut Vec<Shown>,
    ) -> Result<Value, Refusal> {
        let space = self.space_name(layer.space)?;
        let views = nested::layer_views(layer);
        let configuration = self.running(session)?.configuration;
        let expected = configuration.map_or(Ok(0), |c| self.views(c).map(|views| views.len()))?;
        if views.len() != expected {
            return Err(invalid(format!("{} views in a layer of {expected}", views.len())));
        }
        let mut described = Vec::new();
        for (index, view) in views.iter().enumerate() {
            if view.ty != xr::CompositionLayerProjectionView::TYPE {
                return Err(invalid(format!("{:?} stands where a layer's view must", view.ty)));
            }
            let pose = check_pose(&view.pose)?;
            let fov = check_fov(&view.fov)?;
            let part = self.part(session, &view.sub_image)?;
            let mut entry = json!({
                "pose": pose.list(), "fov": fov, "swapchain": view.sub_image.swapchain.into_raw(),
                "rect": [part.x, part.y, part.width as i32, part.height as i32], "array_index": part.layer,
            });
            let swapchain = view.sub_image.swapchain.into_raw();
            parts.push(Shown { name: format!("view{index}"), swapchain, part });
            if let Some(depth) = abi::chained::<xr::CompositionLayerDepthInfoKHR>(view.next, view) {
                let (described, part) = self.depth(session, depth, part)?;
                entry["depth"] = described;
                let swapchain = depth.sub_image.swapchain.into_raw();
                parts.push(Shown { name: format!("depth{index}"), swapchain, part });
            }
            described.push(entry);
        }
        Ok(json!({ "space": space, "flags": layer.layer_flags.into_raw(), "views": described }))
    }

    /// Checks a depth sub-image and describes it.
    fn depth(
        &mut self,
        session: u64,
        depth: &xr::CompositionLayerDepthInfoKHR,
        colour: Part,
    ) -> Result<(Value, Part), Refusal> {
        self.needs("XR_KHR_composition_layer_depth")?;
        let part = self.part(session, &depth.sub_image)?;
        let range = depth.min_depth..=depth.max_depth;
        let within = |depth: &f32| (0.0..=1.0).contains(depth);
        if !within(range.start()) || !within(range.end()) || range.start() >= range.end() {
            return Err(invalid(format!("depths from {:?} are not between 0 and 1", range)));
        }
        if depth.near_z == depth.far_z || !(depth.near_z >= 0.0 && depth.far_z >= 0.0) {
            return Err(invalid(format!("depth between {} and {} metres", depth.near_z, depth.far_z)));
        }
        let usage = self.swapchain(depth.sub_image.swapchain.into_raw())?.shape.usage;
        if !usage.contains(ash::vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT) {
            return Err(invalid("depth in a swapchain of colours"));
        }
        let described = json!({
            "swapchain": depth.sub_image.swapchain.into_raw(),
            "rect": [part.x, part.y, part.width as i32, part.height as i32],
            "same_size": (part.width, part.height) == (colour.width, colour.height),
            // JSON knows no infinity.
            "near_z": depth.near_z.min(f32::MAX), "far_z": depth.far_z.min(f32::MAX),
            "min_depth": depth.min_depth, "max_depth": depth.max_depth,
        });
        Ok((described, part))
    }

    /// Checks a sub-image.
    fn part(&mut self, session: u64, sub: &xr::SwapchainSubImage) -> Result<Part, Refusal> {
        let handle = sub.swapchain.into_raw();
        if self.session_of(handle) != Some(session) {
            return Err(wrong(
                xr::Result::ERROR_HANDLE_INVALID,
                format!("Swapchain {handle} of a layer does not live"),
            ));
        }
        let swapchain = self.swapchain(handle)?;
        let (rect, shape) = (sub.image_rect, swapchain.shape);
        if swapchain.order.released().is_none() {
            return Err(wrong(
                xr::Result::ERROR_LAYER_INVALID,
                "a layer shows a swapchain of which no image was released",
            ));
        }
        let fits = |from: i32, size: i32, all: u32| from >= 0 && size > 0 && from + size <= all as i32;
        if !fits(rect.offset.x, rect.extent.width, shape.width)
            || !fits(rect.offset.y, rect.extent.height, shape.height)
        {
            return Err(wrong(
                xr::Result::ERROR_SWAPCHAIN_RECT_INVALID,
                format!("{rect:?} is not inside {} by {}", shape.width, shape.height),
            ));
        }
        if sub.image_array_index >= shape.layers {
            return Err(invalid(format!("array layer {} of {}", sub.image_array_index, shape.layers)));
        }
        Ok(Part {
            x: rect.offset.x,
            y: rect.offset.y,
            width: rect.extent.width as u32,
            height: rect.extent.height as u32,
            layer: sub.image_array_index,
        })
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
