//! Frames along a course, judged.

use super::Sequence;
use super::scenery::{GAZE, Scenery};
use crate::config::{Config, Stereo};
use crate::error::Result;
use crate::frame::Renderer;
use crate::math::view::View;
use crate::metrics::metric::{Viewing, compare};
use crate::metrics::pairs::disagreement;
use crate::metrics::stats::median;
use crate::metrics::temporal::{BANDS, flicker_by_eccentricity, lag, low_pass_flicker};
use crate::metrics::uncovered::{AGES, error_by_age};
use crate::metrics::{Display, Picture, foveated};
use crate::tradeoff::Effort;
use crate::tradeoff::judge::split;
use crate::tradeoff::reference::{full, taken};
use crate::tradeoff::rivals::{EVERY_PIXEL, plan};
use crate::tradeoff::store::Store;

/// Variants of the settings that are run along courses: as given; each frame for itself; with fewer light rays; a sample in
/// every pixel.
pub(in crate::tradeoff) fn variants(given: &Config, effort: Effort) -> Vec<(String, Config)> {
    let mut list = vec![("as given".to_string(), given.clone())];
    if given.reuses() {
        list.push(("each frame for itself".to_string(), given.clone().without_reuse()));
        for part in if effort == Effort::Quick { &[][..] } else { &[4, 16][..] } {
            let rays = given.trace.rays / part;
            if rays > 0 {
                let mut fewer = given.clone();
                fewer.trace.rays = rays;
                list.push((format!("with {rays} light rays"), fewer));
            }
        }
    }
    list.push((EVERY_PIXEL.to_string(), full(given, given.trace.rays, given.trace.bounces)));
    list
}

/// Frames of a course that are judged.
pub(in crate::tradeoff) struct Run {
    pictures: Vec<Picture>,
    displays: Vec<Display>,
    times: Vec<f64>,
    rays: u64,
}

/// Renders a course's frames, or as many through whose last ones the scene's time goes backwards.
pub(in crate::tradeoff) fn run(
    renderer: &mut Renderer,
    config: &Config,
    scenery: &Scenery,
    viewing: Viewing,
    backwards: bool,
) -> Result<Run> {
    let course = &scenery.course;
    renderer.apply(config)?;
    renderer.forget();
    let mut run = Run { pictures: Vec::new(), displays: Vec::new(), times: Vec::new(), rays: 0 };
    let judged = course.judged();
    for (frame, eyes) in scenery.eyes.iter().enumerate() {
        let time = course.times[frame];
        let mirrored = course.times[judged.start] + course.times[judged.end - 1] - time;
        renderer.show_at(if backwards { mirrored } else { time });
        let plan = plan(eyes, config.view.stereo)?;
        let report = renderer.frame(&plan, &plan.gaze_points(GAZE), frame as u32)?;
        if frame >= course.history {
            let picture = taken(renderer, &plan)?;
            run.displays.push(Display::from_picture(&picture, viewing.exposure));
            run.pictures.push(picture);
            run.times.push(report.frame_ms - report.pattern_ms);
            run.rays = report.rays;
        }
    }
    Ok(run)
}

/// Judges a run, whose pictures (of the first eye) are kept beside the store. `back` is the same backwards, for those that
/// may lag.
pub(in crate::tradeoff) fn judge(
    name: &str,
    run: &Run,
    back: Option<&Run>,
    scenery: &Scenery,
    viewing: Viewing,
    store: &Store,
) -> Result<Sequence> {
    let course = &scenery.course;
    let judged = Judged { scenery, shown: run.displays.iter().collect() };
    let mut psnr = Vec::new();
    for (frame, picture) in run.pictures.iter().enumerate() {
        let left = split(&run.displays[frame], judged.eyes(frame)).swap_remove(0);
        left.write_png(&store.frame(name, course.motion.key(), frame)?)?;
        psnr.push(compare(picture, &scenery.reference(frame).picture, viewing)?.psnr.min(200.0));
    }
    Ok(Sequence {
        name: name.to_string(),
        motion: course.motion,
        history: course.history as u32,
        frames: judged.shown.len() as u32,
        frame_ms: median(&run.times).unwrap_or(0.0),
        rays: run.rays,
        foveated_score: judged.foveated_score(),
        psnr_display: mean(psnr.into_iter()),
        low_pass_flicker: mean(judged.pairs().map(|(tests, truths)| low_pass_flicker(tests, truths))),
        flicker_by_eccentricity: judged.flicker_by_eccentricity(),
        uncovered: judged.uncovered(),
        lag: back.and_then(|back| judged.lag(back)),
        disagreement: judged.disagreement(),
    })
}

/// Pictures beside what they should be.
struct Judged<'a> {
    scenery: &'a Scenery,
    shown: Vec<&'a Display>,
}

impl Judged<'_> {
    fn truth(&self, judged: usize) -> &Display {
        &self.scenery.reference(judged).display
    }

    fn eyes(&self, judged: usize) -> &[View] {
        &self.scenery.eyes[self.scenery.course.history + judged]
    }

    /// Frames that follow each other, with their references.
    fn pairs(&self) -> impl Iterator<Item = ([&Display; 2], [&Display; 2])> {
        (1..self.shown.len())
            .map(|i| ([self.shown[i - 1], self.shown[i]], [self.truth(i - 1), self.truth(i)]))
    }

    fn foveated_score(&self) -> f64 {
        let of = |judged: usize| {
            let eyes = self.eyes(judged);
            let gazes = plan(eyes, Stereo::PerEye).map(|plan| plan.gaze_points(GAZE)).unwrap_or_default();
            let (tests, truths) = (split(self.shown[judged], eyes), split(self.truth(judged), eyes));
            let each = eyes.iter().zip(gazes).zip(tests.iter().zip(&truths));
            let thresholds =
                mean(each.map(|((eye, gaze), (test, truth))| {
                    foveated::difference(test, truth, eye, gaze).thresholds
                }));
            foveated::score(thresholds)
        };
        mean((0..self.shown.len()).map(of))
    }

    fn flicker_by_eccentricity(&self) -> [Option<f64>; BANDS.len()] {
        let eyes = self.eyes(0);
        let left = |display: &Display| split(display, eyes).swap_remove(0);
        let of = |(tests, truths): ([&Display; 2], [&Display; 2])| {
            let (tests, truths) = (tests.map(left), truths.map(left));
            flicker_by_eccentricity([&tests[0], &tests[1]], [&truths[0], &truths[1]], &eyes[0], GAZE)
        };
        means(&self.pairs().map(of).collect::<Vec<_>>())
    }

    fn uncovered(&self) -> Option<[Option<f64>; AGES + 1]> {
        let ages = self.scenery.ages.as_ref()?;
        let of = |judged: usize| {
            let left = |display: &Display| split(display, self.eyes(judged)).swap_remove(0);
            error_by_age(&left(self.shown[judged]), &left(self.truth(judged)), &ages[judged])
        };
        let list: Vec<_> = (0..self.shown.len()).map(of).collect();
        Some(means(&list))
    }

    fn lag(&self, back: &Run) -> Option<f64> {
        let truths: Vec<&Display> = (0..self.shown.len()).map(|i| self.truth(i)).collect();
        lag(&self.shown, &back.displays.iter().rev().collect::<Vec<_>>(), &truths)
    }

    fn disagreement(&self) -> Option<f64> {
        let last = self.shown.len() - 1;
        let eyes = self.eyes(last);
        let (tests, truths) = (split(self.shown[last], eyes), split(self.truth(last), eyes));
        match (tests.as_slice(), truths.as_slice()) {
            ([left, right], [left_truth, right_truth]) => {
                Some(disagreement([left, right], [left_truth, right_truth], &self.scenery.matches))
            }
            _ => None,
        }
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count.max(1))
}

/// The mean of each place, over where there is something.
fn means<const N: usize>(list: &[[Option<f64>; N]]) -> [Option<f64>; N] {
    std::array::from_fn(|place| {
        let values: Vec<f64> = list.iter().filter_map(|values| values[place]).collect();
        (!values.is_empty()).then(|| mean(values.into_iter()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_run_along_courses_differs() {
        let list = variants(&Config::default(), Effort::Usual);
        assert_eq!(list.len(), 5, "{:?}", list.iter().map(|(name, _)| name).collect::<Vec<_>>());
        for (i, (_, config)) in list.iter().enumerate() {
            assert!(list[..i].iter().all(|(_, other)| other != config));
        }
        assert!(list[0].1.time.reuse && !list[1].1.time.reuse);
        // Without reuse each frame stands for itself anyway.
        assert_eq!(variants(&Config::default().without_reuse(), Effort::Usual).len(), 2);
    }

    #[test]
    fn means_leave_out_what_is_not_there() {
        assert_eq!(means(&[[Some(1.0), None], [Some(3.0), None]]), [Some(2.0), None]);
    }
}
