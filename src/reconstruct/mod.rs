//! From sparse samples to every pixel of a view, on the device that presents.
//!
//! A new pattern ([`Reconstruction::set_pattern`]) has its neighbours found once on the device: the k
//! samples nearest to each pixel with their weights, and, for guided reconstruction, those nearest to
//! each sample. A frame ([`Reconstruction::submit`]) then takes two kinds of passes: over the samples
//! (what is not finite is taken out; guided: each is averaged with its neighbours on its surface),
//! and one over the pixels, which writes the target.
//!
//! The pass over the pixels is a fragment shader, because swapchains of SRGB formats take no other; on
//! lavapipe it costs what a compute shader costs. Neighbours are found on the device, because that was
//! the faster of the two there (180 against 280 ms of CPU time for a guided pattern of 55,000 samples in
//! 1280x800 pixels, when each pixel known by itself on both; pixels that search in blocks have halved
//! the former since), and tables never leave the device's memory.

mod denoise;
mod frame;
mod history;
mod magnify;
mod motion_vectors;
mod motions;
mod overlay;
mod parameters;
mod pixels;
mod reprojection;
mod resolve;
mod samples;
mod settings;
mod shaders;
mod staging;
mod tables;
#[cfg(test)]
mod tests;

use std::collections::HashMap;

pub use frame::{Frame, NEAREST_DEPTH, Output};
pub use history::Reuse;
pub use motion_vectors::MotionImage;
pub use overlay::Overlay;
pub use settings::{GuidedSettings, MAX_K, MAX_NEIGHBOURS, Mode, Settings, Weights};

use glam::DVec2;

use crate::error::Result;
use crate::gpu::vulkan::{Attachments, BufferRef, Commands, Context, HostBuffer, PassPipeline, StageTime};
use crate::layout::{SampleRecord, VisibilityRecord};
use crate::math::view::View;
use crate::trace::pattern_maker::PatternTables;
use denoise::Denoise;
use history::{Accumulate, Fresh, History};
use magnify::Magnify;
use motion_vectors::{LastPicture, MotionPasses};
use parameters::{PackedSpacing, PixelParameters, rays};
use reprojection::Reprojection;
use resolve::{Means, Resolve};
use samples::Prepare;
use staging::Staging;
use tables::{Finders, Tables};

/// Reconstructs pictures on one device with one set of settings.
pub struct Reconstruction {
    context: Context,
    settings: Settings,
    finders: Finders,
    prepare: Prepare,
    denoise: Option<Denoise>,
    accumulate: Option<Accumulate>,
    /// Where pixels are means over several pictures.
    resolve: Option<Resolve>,
    /// Made for the first view that needs it.
    magnify: Option<Magnify>,
    passes: HashMap<Attachments, PassPipeline>,
    motion: MotionPasses,
    views: Vec<ViewState>,
}

struct ViewState {
    tables: Tables,
    /// What was traced, where that lies in the host's memory.
    samples: Staging,
    visibility: Staging,
    commands: Commands,
    dropped: HostBuffer,
    warp: HostBuffer,
    /// The same for the mean over several pictures.
    mean_warp: HostBuffer,
    history: History,
    means: Means,
    last_picture: LastPicture,
    /// Radiance of the view's pixels, where they are not its picture's.
    shaded: Option<BufferRef>,
}

impl Reconstruction {
    /// Builds the shaders.
    ///
    /// # Errors
    /// [`crate::Error::Setting`] for settings out of range, [`crate::Error::Kernel`] if a shader cannot be built.
    pub fn new(context: &Context, settings: Settings) -> Result<Self> {
        settings.validate()?;
        Ok(Reconstruction {
            context: context.clone(),
            finders: Finders::new(context, &settings)?,
            accumulate: match (settings.mode, settings.reuse) {
                (Mode::Guided(_), Some(reuse)) => Some(Accumulate::new(context, reuse)?),
                _ => None,
            },
            resolve: match (settings.mode, settings.reuse) {
                (Mode::Guided(_), Some(reuse)) if reuse.pictures > 1 => {
                    Some(Resolve::new(context, reuse.pictures)?)
                }
                _ => None,
            },
            magnify: None,
            settings,
            prepare: Prepare::new(context, &settings)?,
            denoise: match settings.mode {
                Mode::Guided(guided) if guided.neighbours > 1 => Some(Denoise::new(context, guided)?),
                _ => None,
            },
            passes: HashMap::new(),
            motion: MotionPasses::default(),
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
    /// [`crate::Error::Setting`] without samples, with a sample outside the view, with more samples or pixels
    /// than the device reaches; [`crate::Error::Device`] without memory.
    pub fn set_pattern(&mut self, view: usize, width: u32, height: u32, samples: &[u32]) -> Result<()> {
        self.set_sorted_pattern(view, (width, height), samples, None)
    }

    /// The same with samples that may be sorted already, or whose neighbours may be known: those that
    /// [`Settings::lists`] tells.
    ///
    /// # Errors
    /// As [`Reconstruction::set_pattern`].
    pub fn set_sorted_pattern(
        &mut self,
        view: usize,
        size: (u32, u32),
        samples: &[u32],
        known: Option<PatternTables>,
    ) -> Result<()> {
        assert!(view <= self.views.len(), "view {view} comes before view {}", self.views.len());
        if view == self.views.len() {
            self.views.push(ViewState {
                tables: Tables::new(&self.context)?,
                samples: Staging::default(),
                visibility: Staging::default(),
                commands: Commands::new(&self.context)?,
                dropped: HostBuffer::new(&self.context, 4)?,
                warp: HostBuffer::new(&self.context, size_of::<Reprojection>())?,
                mean_warp: HostBuffer::new(&self.context, size_of::<Reprojection>())?,
                history: History::default(),
                means: Means::default(),
                last_picture: LastPicture::default(),
                shaded: None,
            });
        }
        let state = &mut self.views[view];
        state.commands.wait()?;
        state.history.stir();
        state.tables.set(&self.context, &self.settings, &self.finders, size, samples, known)
    }

    /// Waits for the neighbours of a view's pattern, and says how long finding them took; empty if
    /// that was asked before.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost.
    pub fn wait_pattern(&mut self, view: usize) -> Result<Vec<StageTime>> {
        self.views.get_mut(view).map_or(Ok(Vec::new()), |state| state.tables.wait())
    }

    /// Starts a frame of a view: see [`Frame`]. Waits for the view's frame before.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost or out of memory, [`crate::Error::Kernel`] if a shader cannot
    /// be built for a target's format.
    ///
    /// # Panics
    /// If the view has no pattern, sizes disagree, a rectangle reaches beyond target or view, or the
    /// frame is to be shown from elsewhere and [`Reconstruction::can_warp`] says no.
    pub fn submit(&mut self, view: usize, frame: &Frame<'_>) -> Result<()> {
        let even = frame.view.spacing.is_even();
        self.require_passes(frame)?;
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
        let samples = state.samples.local(&self.context, commands, &frame.samples, bytes)?;
        // Several passes read it, and each pixel its neighbours' too.
        let visibility = frame.visibility.as_ref().map(|visibility| {
            let bytes = visibility.size().min(frame.view.pixels() * size_of::<VisibilityRecord>());
            state.visibility.local(&self.context, commands, visibility, bytes)
        });
        let frame = &Frame { visibility: visibility.transpose()?, ..frame.clone() };
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
                let (longest, light_changes) = (frame.light_holds, frame.light_changes);
                let fresh = Fresh {
                    view,
                    movers: &frame.movers,
                    samples,
                    visibility,
                    rays,
                    pixel_width,
                    normal_power,
                    plane_tolerance,
                    longest,
                    light_changes,
                    estimates: frame.estimates,
                    rests: frame.rests,
                };
                let history = &mut state.history;
                let records =
                    accumulate.record(&self.context, commands, tables, history, other.as_ref(), &fresh)?;
                tables.keep();
                commands.end_stage("accumulate");
                records
            }
            _ => {
                state.history.forget();
                samples
            }
        };
        let of_view = (rays, PackedSpacing::of(frame.view), pixel_width, frame.least_expected);
        self.prepare.record(commands, tables, &self.settings, &samples, &dropped, of_view)?;
        if let Some(denoise) = &self.denoise {
            denoise.record(&self.context, commands, tables, &samples, of_view)?;
        }
        commands.end_stage("filter");
        let parameters = PixelParameters::new(tables, &self.settings, frame, rays, pixel_width);
        if let Some(magnify) = self.magnify.as_ref().filter(|_| !even) {
            let shaded = magnify::room(&self.context, &mut state.shaded, frame.view.pixels())?;
            magnify.shade(commands, tables, frame, parameters, [&warp, &shaded])?;
            let (warp, shaded) = match (&self.resolve, &frame.visibility) {
                (Some(resolve), Some(visibility)) => {
                    let mean = View { spacing: frame.view.spacing.shifted(-frame.jitter), ..*frame.view };
                    let reprojection = Reprojection::new(&mean, frame.shown_from).with(&mean, frame.overlay);
                    state.mean_warp.write(0, &[reprojection]);
                    let of_frame = (rays, visibility, &shaded);
                    let means = resolve.record(&self.context, commands, &mut state.means, frame, of_frame)?;
                    (BufferRef::from(&state.mean_warp), means)
                }
                _ => (warp.clone(), shaded),
            };
            for output in frame.outputs {
                magnify.draw(commands, tables, frame, output, rays, [&warp, &shaded])?;
            }
        }
        for output in frame.outputs.iter().filter(|_| even) {
            let pass = &self.passes[&output.target.attachments()];
            pixels::draw(commands, pass, tables, &self.settings, frame, output, (parameters, &warp))?;
        }
        let last = &mut state.last_picture;
        self.motion.record(&self.context, commands, (tables, &self.settings), last, frame, (rays, &warp))?;
        commands.end_stage("reconstruct");
        commands.submit()
    }

    /// Makes the passes that a frame's outputs need and there are not yet.
    fn require_passes(&mut self, frame: &Frame<'_>) -> Result<()> {
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
            if let Some(image) = output.motion {
                self.motion.require(&self.context, image.target.attachments())?;
            }
        }
        Ok(())
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
    /// [`crate::Error::Device`] if the device is lost.
    pub fn wait(&mut self, view: usize) -> Result<Vec<StageTime>> {
        self.views.get_mut(view).map_or(Ok(Vec::new()), |state| state.commands.wait())
    }

    /// The next frames find nothing of those before: after a cut, or where each frame has to stand for itself.
    pub fn forget(&mut self) {
        self.views.iter_mut().for_each(|state| {
            state.history.forget();
            state.means.forget();
        });
    }

    /// Where within its pixels the rays of a view's next frame are to look, in pixels from their middles: see
    /// [`crate::math::spacing::Spacing::shifted`].
    pub fn jitter(&self, index: usize, view: &View) -> DVec2 {
        let means = self.views.get(index).map(|state| &state.means).filter(|_| self.resolve.is_some());
        means.map_or(DVec2::ZERO, |means| means.jitter(view))
    }

    /// Whether pixels of views that are not even are means over their last pictures.
    pub fn takes_means(&self) -> bool {
        self.resolve.is_some()
    }

    /// Whether the next frame of the `index`-th view finds one before it.
    pub fn has_history(&self, index: usize) -> bool {
        self.views.get(index).is_some_and(|state| state.history.is_there())
    }

    /// Whether the next frame of the `index`-th view takes light from one before it that was seen from nearly the same
    /// place.
    pub fn remembers(&self, index: usize, view: &View) -> bool {
        self.views.get(index).is_some_and(|state| state.history.is_near(view))
    }

    /// Whether so many frames of the `index`-th view have rested, and the next one does: all with one pattern, seen from the
    /// same place, in light that stays. Then its samples may take turns ([`crate::trace::Turn`]).
    pub fn rests(&self, index: usize, view: &View, frames: u32) -> bool {
        self.views.get(index).is_some_and(|state| state.history.rests(view, frames))
    }

    /// How many samples of a view's last frame that was waited for were not finite and were left out.
    pub fn dropped(&self, view: usize) -> u32 {
        self.views.get(view).map_or(0, |state| state.dropped.read::<u32>(0, 1)[0])
    }
}
