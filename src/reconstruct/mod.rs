//! From sparse samples to every pixel of a view, on the device that presents.
//!
//! A new pattern ([`Reconstruction::set_pattern`]) has its neighbours found once on the device: the k
//! samples nearest to each pixel with their weights, and, for guided reconstruction, those nearest to
//! each sample. A frame ([`Reconstruction::submit`]) then takes two passes: one over the samples
//! (what is not finite is taken out; guided: each is averaged with its neighbours on its surface),
//! and one over the pixels, which writes the target.
//!
//! The pass over the pixels is a fragment shader, because swapchains of SRGB formats take no other; on
//! lavapipe it costs what a compute shader costs. Neighbours are found on the device, because that was
//! the faster of the two there (180 against 280 ms of CPU time for a guided pattern of 55,000 samples in
//! 1280x800 pixels, when each pixel searched by itself on both; pixels that search in blocks have halved
//! the former since), and tables never leave the device's memory.

mod grid;
mod history;
mod magnify;
mod overlay;
mod reprojection;
mod settings;
mod shaders;
mod tables;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

use bytemuck::{Pod, Zeroable};
use glam::DVec2;

pub use history::Reuse;
pub use overlay::Overlay;
pub use settings::{GuidedSettings, MAX_K, MAX_NEIGHBOURS, Mode, Settings, Weights};

use crate::error::{Error, Result};
use crate::gpu::vulkan::{
    Attachments, BufferRef, Commands, ComputePipeline, Context, Encoding, HostBuffer, PassPipeline, Rect,
    StageTime, Target,
};
use crate::layout::{SampleRecord, VisibilityRecord};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::scene::Sun;
use history::{Accumulate, Fresh, History};
use magnify::Magnify;
use reprojection::Reprojection;
use settings::PREPARED_BYTES;
use tables::{Finders, Tables};

/// Samples that one dispatch of a pass without neighbours takes.
const SAMPLES_AT_ONCE: usize = 1 << 21;

/// Metres at which a target's depth is 1; it falls as 1/z, and is 0 infinitely far away and, without guided
/// reconstruction, everywhere. Reversed like this, floating-point depths are equally exact at all distances.
pub const NEAREST_DEPTH: f32 = 0.05;

/// Reconstructs pictures on one device with one set of settings.
pub struct Reconstruction {
    context: Context,
    settings: Settings,
    finders: Finders,
    prepare: Prepare,
    accumulate: Option<Accumulate>,
    /// Made for the first view that needs it.
    magnify: Option<Magnify>,
    passes: HashMap<Attachments, PassPipeline>,
    views: Vec<ViewState>,
}

struct Prepare {
    take: ComputePipeline,
    filter: Option<ComputePipeline>,
}

struct ViewState {
    tables: Tables,
    commands: Commands,
    dropped: HostBuffer,
    warp: HostBuffer,
    history: History,
    /// Radiance of the view's pixels, where they are not its picture's.
    shaded: Option<BufferRef>,
}

/// What a frame's samples are made into.
pub struct Frame<'a> {
    /// Where the eye is and what it sees; its size is the pattern's. Outputs show its picture: pixels that are not even
    /// are for guided reconstruction, and for views of at most [`Reconstruction::most_pixels`].
    pub view: &'a View,
    /// One [`SampleRecord`] for each sample of the pattern, in its order.
    pub samples: BufferRef,
    /// One [`VisibilityRecord`] for each pixel, row after row; needed for guided reconstruction.
    pub visibility: Option<BufferRef>,
    /// The sun whose visibility the records hold: its light is added at each pixel (guided).
    pub sun: Option<Sun>,
    /// Radiance, above 0, below which reflections that pixels expect count no more than others (guided): a small
    /// share of the environment's.
    pub least_expected: f32,
    /// Where the eye is when the picture is seen: pixels are moved to where it sees them, by their depths
    /// (guided) or as if all were far away. `None` where that is where the view was traced from.
    pub shown_from: Option<Pose>,
    /// Stops that come to each output's own.
    pub exposure: f32,
    /// The view of the other eye, whose samples may serve this one: see [`Settings::reuse`].
    pub other: Option<usize>,
    /// What is drawn over the picture, and the gaze in 0..1 of it.
    pub overlay: (Overlay, DVec2),
    /// Where the pixels go: rectangles of one target do not overlap.
    pub outputs: &'a [Output<'a>],
}

/// A rectangle of a target that shows a rectangle of the view.
pub struct Output<'a> {
    /// The target.
    pub target: &'a Target,
    /// The part of the target that is written; the rest is kept.
    pub rect: Rect,
    /// The view's pixel (x, y) that comes to the rectangle's upper left corner.
    pub source: [u32; 2],
    /// What the target's numbers mean.
    pub encoding: Encoding,
    /// Exposure in EV: radiance is multiplied by two to its power before tone mapping.
    pub exposure: f32,
}

impl<'a> Output<'a> {
    /// The view's upper left part over the whole target, with its format's usual encoding.
    pub fn whole(target: &'a Target, exposure: f32) -> Self {
        let rect = Rect { x: 0, y: 0, width: target.width(), height: target.height() };
        Output { target, rect, source: [0, 0], encoding: Encoding::of(target.format()), exposure }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Rays {
    corner: [f32; 4],
    across: [f32; 4],
    down: [f32; 4],
}

/// How far apart a view's pixels are, as shaders take it: from the centre of the first one.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PackedSpacing {
    columns: [f32; 4],
    rows: [f32; 4],
}

impl PackedSpacing {
    fn of(view: &View) -> PackedSpacing {
        PackedSpacing { columns: view.spacing.columns.packed(-0.5), rows: view.spacing.rows.packed(-0.5) }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FilterParameters {
    rays: Rays,
    spacing: PackedSpacing,
    count: u32,
    neighbours: u32,
    normal_power: f32,
    plane_tolerance: f32,
    first_deviation: f32,
    second_deviation: f32,
    pixel_width: f32,
    least_expected: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PixelParameters {
    rays: Rays,
    shift_x: i32,
    shift_y: i32,
    width: u32,
    first_row: u32,
    rows: u32,
    neighbours: u32,
    first_sample: u32,
    exposure: f32,
    encoding: u32,
    normal_power: f32,
    plane_tolerance: f32,
    pixel_width: f32,
    count: u32,
    sample_neighbours: u32,
    sun: [f32; 3],
    nearest_depth: f32,
    sun_radius: f32,
    least_expected: f32,
}

impl Reconstruction {
    /// Builds the shaders.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings out of range, [`Error::Kernel`] if a shader cannot be built.
    pub fn new(context: &Context, settings: Settings) -> Result<Self> {
        settings.validate()?;
        let pipeline = |entry| ComputePipeline::new(context, &shaders::FILTER, entry);
        let prepare = match settings.mode {
            Mode::KNearest => Prepare { take: pipeline("take_radiance")?, filter: None },
            Mode::Guided(guided) if guided.neighbours == 1 => {
                Prepare { take: pipeline("take_records")?, filter: None }
            }
            Mode::Guided(_) => {
                Prepare { take: pipeline("take_records")?, filter: Some(pipeline("filter_samples")?) }
            }
        };
        Ok(Reconstruction {
            context: context.clone(),
            finders: Finders::new(context, &settings)?,
            accumulate: match (settings.mode, settings.reuse) {
                (Mode::Guided(_), Some(reuse)) => Some(Accumulate::new(context, reuse)?),
                _ => None,
            },
            magnify: None,
            settings,
            prepare,
            passes: HashMap::new(),
            views: Vec::new(),
        })
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Gives a view a new pattern: `samples` are pixel positions packed `x | y << 16`, in any order, of
    /// a view of `width` x `height` pixels. Neighbours are found on the device while this returns;
    /// frames submitted later use them. Views are numbered from 0 without gaps.
    ///
    /// # Errors
    /// [`Error::Setting`] without samples, with a sample outside the view, with more samples or pixels
    /// than the device reaches; [`Error::Device`] without memory.
    pub fn set_pattern(&mut self, view: usize, width: u32, height: u32, samples: &[u32]) -> Result<()> {
        assert!(view <= self.views.len(), "view {view} comes before view {}", self.views.len());
        if view == self.views.len() {
            self.views.push(ViewState {
                tables: Tables::new(&self.context)?,
                commands: Commands::new(&self.context)?,
                dropped: HostBuffer::new(&self.context, 4)?,
                warp: HostBuffer::new(&self.context, size_of::<Reprojection>())?,
                history: History::default(),
                shaded: None,
            });
        }
        let state = &mut self.views[view];
        state.commands.wait()?;
        state.tables.set(&self.context, &self.settings, &self.finders, (width, height), samples)
    }

    /// Waits for the neighbours of a view's pattern, and says how long finding them took; empty if
    /// that was asked before.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost.
    pub fn wait_pattern(&mut self, view: usize) -> Result<Vec<StageTime>> {
        self.views.get_mut(view).map_or(Ok(Vec::new()), |state| state.tables.wait())
    }

    /// Starts a frame of a view: see [`Frame`]. Waits for the view's frame before.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost or out of memory, [`Error::Kernel`] if a shader cannot
    /// be built for a target's format.
    ///
    /// # Panics
    /// If the view has no pattern, sizes disagree, a rectangle reaches beyond target or view, or the
    /// frame is to be shown from elsewhere and [`Reconstruction::can_warp`] says no.
    pub fn submit(&mut self, view: usize, frame: &Frame<'_>) -> Result<()> {
        let even = frame.view.spacing.is_even();
        if !even && self.magnify.is_none() {
            self.magnify = Some(Magnify::new(&self.context)?);
        }
        for output in frame.outputs {
            let attachments = output.target.attachments();
            match self.magnify.as_mut().filter(|_| !even) {
                Some(magnify) => magnify.require_pass(&self.context, attachments)?,
                None => self.require_pass(attachments)?,
            }
        }
        let other =
            frame.other.and_then(|other| self.views.get(other)).and_then(|other| other.history.lend());
        let state = &mut self.views[view];
        let tables = &mut state.tables;
        assert_eq!((frame.view.width, frame.view.height), (tables.width, tables.height), "size of the view");
        let bytes = tables.count * size_of::<SampleRecord>();
        assert!(frame.samples.size() >= bytes, "one record for each of {} samples", tables.count);
        assert!(frame.shown_from.is_none() || tables.bands().len() == 1, "the view is too large to warp");
        let commands = &mut state.commands;
        commands.begin()?;
        state
            .warp
            .write(0, &[Reprojection::new(frame.view, frame.shown_from).with(frame.view, frame.overlay)]);
        let warp = BufferRef::from(&state.warp);
        let samples = tables.staged(&self.context, commands, &frame.samples, bytes)?;
        let dropped = BufferRef::from(&state.dropped);
        commands.fill_zero(&dropped);
        commands.barrier();
        let rays = rays(frame.view, frame.sun);
        let pixel_width = f64::from(rays.across[0]).hypot(f64::from(rays.across[1]));
        let pixel_width = pixel_width.hypot(f64::from(rays.across[2])) as f32;
        let samples = match (&self.accumulate, &frame.visibility) {
            (Some(accumulate), Some(visibility)) if tables.bands().len() == 1 => {
                let GuidedSettings { normal_power, plane_tolerance, .. } = self.settings.guided();
                let view = frame.view;
                let samples = &samples;
                let fresh =
                    Fresh { view, samples, visibility, rays, pixel_width, normal_power, plane_tolerance };
                let history = &mut state.history;
                let records =
                    accumulate.record(&self.context, commands, tables, history, other.as_ref(), &fresh)?;
                tables.keep();
                commands.end_stage("accumulate");
                records
            }
            _ => samples,
        };
        self.prepare.record(
            commands,
            tables,
            &self.settings,
            &samples,
            &dropped,
            (rays, PackedSpacing::of(frame.view), pixel_width, frame.least_expected),
        )?;
        commands.end_stage("filter");
        let parameters = PixelParameters::new(tables, &self.settings, frame, rays, pixel_width);
        if let Some(magnify) = self.magnify.as_ref().filter(|_| !even) {
            let shaded = magnify::room(&self.context, &mut state.shaded, frame.view.pixels())?;
            magnify.shade(commands, tables, frame, parameters, [&warp, &shaded])?;
            for output in frame.outputs {
                magnify.draw(commands, tables, frame, output, rays, [&warp, &shaded])?;
            }
        }
        for output in frame.outputs.iter().filter(|_| even) {
            let pass = &self.passes[&output.target.attachments()];
            draw(commands, pass, tables, &self.settings, frame, output, (parameters, &warp))?;
        }
        commands.end_stage("reconstruct");
        commands.submit()
    }

    /// The most pixels of a view that may be spaced unevenly: their tables fit one binding each.
    pub fn most_pixels(&self) -> usize {
        let record = size_of::<VisibilityRecord>().max(4 * self.settings.k as usize);
        (self.context.storage_range() / record as u64) as usize
    }

    /// Whether a view's frames can be shown from elsewhere: not where its tables are too large for one
    /// binding, since a pixel may then see what lies in another one.
    pub fn can_warp(&self, view: usize) -> bool {
        self.views.get(view).is_some_and(|state| state.tables.bands().len() == 1)
    }

    fn require_pass(&mut self, to: Attachments) -> Result<()> {
        if !self.passes.contains_key(&to) {
            let fragment = match (self.settings.mode, to.depth) {
                (Mode::KNearest, _) => "k_nearest",
                (Mode::Guided(_), None) => "guided",
                (Mode::Guided(_), Some(_)) => "guided_with_depth",
            };
            let pass = PassPipeline::new(&self.context, &shaders::RECONSTRUCT, "cover", fragment, to)?;
            self.passes.insert(to, pass);
        }
        Ok(())
    }

    /// Waits for a view's frame, and says how long its stages took on the device; empty if there is
    /// none to wait for.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost.
    pub fn wait(&mut self, view: usize) -> Result<Vec<StageTime>> {
        self.views.get_mut(view).map_or(Ok(Vec::new()), |state| state.commands.wait())
    }

    /// The next frames find nothing of those before: after a cut, or where each frame has to stand for itself.
    pub fn forget(&mut self) {
        self.views.iter_mut().for_each(|state| state.history.forget());
    }

    /// Whether the next frame of the `index`-th view takes light from one before it that was seen from nearly the same
    /// place.
    pub fn remembers(&self, index: usize, view: &View) -> bool {
        self.views.get(index).is_some_and(|state| state.history.is_near(view))
    }

    /// How many samples of a view's last frame that was waited for were not finite and were left out.
    pub fn dropped(&self, view: usize) -> u32 {
        self.views.get(view).map_or(0, |state| state.dropped.read::<u32>(0, 1)[0])
    }
}

/// Where the pixels of the view's picture look, in world orientation, at depth 1 metre.
/// The fourth components hold the direction towards the sun.
fn rays(view: &View, sun: Option<Sun>) -> Rays {
    let view = &view.picture();
    let toward = |x: f64, y: f64| view.world_from_eye.rotation * view.eye_direction(DVec2::new(x, y));
    let corner = toward(0.5, 0.5);
    let sun = sun.map_or(glam::Vec3::ZERO, |sun| sun.direction);
    let vector = |v: glam::DVec3, w: f32| [v.x as f32, v.y as f32, v.z as f32, w];
    Rays {
        corner: vector(corner, sun.x),
        across: vector(toward(1.5, 0.5) - corner, sun.y),
        down: vector(toward(0.5, 1.5) - corner, sun.z),
    }
}

impl Prepare {
    /// Records the pass over the samples.
    fn record(
        &self,
        commands: &mut Commands,
        tables: &Tables,
        settings: &Settings,
        samples: &BufferRef,
        dropped: &BufferRef,
        (rays, spacing, pixel_width, least_expected): (Rays, PackedSpacing, f32, f32),
    ) -> Result<()> {
        let guided = settings.guided();
        let mut parameters = FilterParameters {
            rays,
            spacing,
            count: tables.count as u32,
            neighbours: tables.neighbours,
            normal_power: guided.normal_power,
            plane_tolerance: guided.plane_tolerance,
            first_deviation: guided.first_deviation,
            second_deviation: guided.second_deviation,
            pixel_width,
            least_expected,
        };
        if let (Some(filter), Some(nearest)) = (&self.filter, tables.nearest()) {
            let buffers = [
                Some(samples),
                Some(tables.prepared()),
                Some(dropped),
                Some(tables.positions()),
                Some(nearest),
            ];
            let groups = [parameters.count.div_ceil(64), 1, 1];
            return commands.dispatch(filter, &buffers, bytemuck::bytes_of(&parameters), groups);
        }
        let stride = PREPARED_BYTES;
        for first in (0..tables.count).step_by(SAMPLES_AT_ONCE) {
            let count = SAMPLES_AT_ONCE.min(tables.count - first);
            parameters.count = count as u32;
            let size = size_of::<SampleRecord>();
            let from = samples.part(first * size, count * size);
            let to = tables.prepared().part(first * stride, count * stride);
            let buffers = [Some(&from), Some(&to), Some(dropped), None, None];
            let groups = [parameters.count.div_ceil(64), 1, 1];
            commands.dispatch(&self.take, &buffers, bytemuck::bytes_of(&parameters), groups)?;
        }
        Ok(())
    }
}

impl PixelParameters {
    /// For the whole view, without what depends on the output.
    fn new(tables: &Tables, settings: &Settings, frame: &Frame<'_>, rays: Rays, pixel_width: f32) -> Self {
        let guided = settings.guided();
        PixelParameters {
            rays,
            shift_x: 0,
            shift_y: 0,
            width: tables.width,
            first_row: 0,
            rows: tables.height,
            neighbours: tables.k,
            first_sample: 0,
            exposure: 1.0,
            encoding: 0,
            normal_power: guided.normal_power,
            plane_tolerance: guided.plane_tolerance,
            pixel_width,
            count: tables.count as u32,
            sample_neighbours: tables.neighbours,
            sun: frame.sun.map_or([0.0; 3], |sun| (sun.radiance * sun.solid_angle() as f32).to_array()),
            nearest_depth: NEAREST_DEPTH,
            sun_radius: frame.sun.map_or(0.0, |sun| (0.5 * (1.0 - sun.cos_radius)).sqrt()),
            least_expected: frame.least_expected,
        }
    }
}

impl Output<'_> {
    /// Factor on radiance, with so many more stops.
    fn factor(&self, stops: f32) -> f32 {
        (self.exposure + stops).exp2()
    }

    /// What is added to a pixel of the target for the one that it shows.
    fn shift(&self) -> [i32; 2] {
        [self.source[0] as i32 - self.rect.x as i32, self.source[1] as i32 - self.rect.y as i32]
    }

    /// # Panics
    /// If it reaches beyond a picture of that size.
    fn require_inside(&self, width: u32, height: u32) {
        let reach = |source: u32, size: u32| u64::from(source) + u64::from(size);
        let inside = reach(self.source[0], self.rect.width) <= u64::from(width)
            && reach(self.source[1], self.rect.height) <= u64::from(height);
        assert!(inside, "{:?} from {:?} on reaches beyond the view", self.rect, self.source);
    }
}

/// As shaders number them.
fn encoding(encoding: Encoding) -> u32 {
    match encoding {
        Encoding::Radiance => 0,
        Encoding::DisplayLinear => 1,
        Encoding::DisplaySrgb => 2,
    }
}

/// Records the pass over the pixels of one output, band by band.
fn draw(
    commands: &mut Commands,
    pass: &PassPipeline,
    tables: &Tables,
    settings: &Settings,
    frame: &Frame<'_>,
    output: &Output<'_>,
    (parameters, warp): (PixelParameters, &BufferRef),
) -> Result<()> {
    let Rect { x, y, width, height } = output.rect;
    let source_y = output.source[1];
    output.require_inside(tables.width, tables.height);
    let [shift_x, shift_y] = output.shift();
    for band in tables.bands() {
        let first = band.first_row.max(source_y);
        let end = (band.first_row + band.rows).min(source_y + height);
        if first >= end {
            continue;
        }
        let parameters = PixelParameters {
            shift_x,
            shift_y,
            first_row: band.first_row,
            rows: band.rows,
            first_sample: band.first_sample,
            exposure: output.factor(frame.exposure),
            encoding: encoding(output.encoding),
            ..parameters
        };
        let first_sample = band.first_sample as usize;
        let prepared = tables.prepared().part(first_sample * PREPARED_BYTES, band.samples * PREPARED_BYTES);
        let positions = tables.positions().part(first_sample * 4, band.samples * 4);
        let visibility = visible_rows(frame, settings, tables, band)?;
        let buffers = [
            Some(&prepared),
            Some(&band.indices),
            Some(&band.weights),
            Some(&positions),
            visibility.as_ref(),
            Some(tables.nearest().unwrap_or(&positions)),
            Some(warp),
            None,
        ];
        let rect = Rect { x, y: y + first - source_y, width, height: end - first };
        commands.draw(pass, output.target, rect, &buffers, bytemuck::bytes_of(&parameters))?;
    }
    Ok(())
}

/// The band's part of the frame's visibility; none where it is not used.
fn visible_rows(
    frame: &Frame<'_>,
    settings: &Settings,
    tables: &Tables,
    band: &tables::Band,
) -> Result<Option<BufferRef>> {
    if settings.mode == Mode::KNearest {
        return Ok(None);
    }
    let row = tables.width as usize * size_of::<VisibilityRecord>();
    let (first, size) = (band.first_row as usize * row, band.rows as usize * row);
    match &frame.visibility {
        Some(visibility) if visibility.size() >= first + size => Ok(Some(visibility.part(first, size))),
        _ => Err(Error::setting(
            "reconstruct",
            "guided reconstruction needs a visibility record for each pixel; trace them, or use k-nn",
        )),
    }
}
