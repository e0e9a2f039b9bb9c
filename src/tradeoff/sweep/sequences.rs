//! The sweep's last part: sequences of frames.

use super::Bench;
use super::meter::Meter;
use crate::error::Result;
use crate::frame::Renderer;
use crate::tradeoff::reference::Making;
use crate::tradeoff::sequence::{Course, Motion, Sequence, judge, prepare, run, variants};

impl Bench<'_> {
    /// Runs all variants along all motions, or what is left of that since a run before.
    pub(super) fn sequences(&self, renderer: &mut Renderer, meter: &mut Meter<'_>) -> Result<Vec<Sequence>> {
        let subject = self.subject;
        let making = Making {
            base: subject.config,
            passes: subject.effort.passes(),
            rays: subject.effort.reference_rays(),
            bounces: subject.config.trace.bounces,
            viewing: self.viewing,
        };
        let variants = variants(subject.config, subject.effort);
        let mut list = Vec::new();
        for motion in motions(subject) {
            let (rest, reach, hz) = subject.rest;
            let course = Course::new(motion, rest, subject.effort.frames(), hz, reach);
            let frames = course.heads.len();
            let work = meter.pass;
            let mut tick = |made: bool| if made { meter.add(work) } else { meter.skip(work) };
            let scenery = prepare(renderer, course, subject.views, &making, &self.store, &mut tick)?;
            for (name, config) in &variants {
                let part = format!("sequence {name} {}", motion.key());
                let work = meter.frames(config, frames);
                let sequence = match self.store.read(&part) {
                    Some(sequence) => {
                        meter.skip(work);
                        sequence
                    }
                    None => {
                        let viewing = self.viewing;
                        let frames = run(renderer, config, &scenery, viewing, false)?;
                        let back = match motion {
                            Motion::Scene if config.reuses() => {
                                Some(run(renderer, config, &scenery, viewing, true)?)
                            }
                            _ => None,
                        };
                        let sequence = judge(name, &frames, back.as_ref(), &scenery, viewing, &self.store)?;
                        self.store.write(&part, &sequence)?;
                        meter.add(work);
                        sequence
                    }
                };
                list.push(sequence);
            }
        }
        renderer.show_at(0.0);
        Ok(list)
    }
}

/// The motions that show anything here: a scene that stands still has four.
pub(super) fn motions(subject: &super::Subject<'_>) -> impl Iterator<Item = Motion> {
    let moves = subject.moves;
    subject.effort.motions().iter().copied().filter(move |motion| moves || *motion != Motion::Scene)
}
