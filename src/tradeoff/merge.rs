//! Presets from the measurements of several scenes.

use serde::{Deserialize, Serialize};

use super::report::Report;
use crate::config::{OperatingPoint, preset};
use crate::error::{Error, Result};
use crate::frame::front::{on_front, with_ladder};

/// What one scene told: enough to judge presets by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The scene.
    pub scene: String,
    /// What it was measured on.
    pub device: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// The points that aim at the same picture, with their names.
    pub points: Vec<(String, OperatingPoint)>,
}

impl Measured {
    /// The points of a report that differ in speed and noise only.
    pub fn of(report: &Report) -> Measured {
        let aim = report.points.first().and_then(|p| p.operating).map(|o| o.bounces);
        let usable = report.points.iter().filter_map(|p| Some((p.name.clone(), p.operating?)));
        Measured {
            scene: report.scene.clone(),
            device: report.device.clone(),
            size: report.size,
            points: usable.filter(|(_, o)| Some(o.bounces) == aim).collect(),
        }
    }

    /// How far a point is from this scene's front: by which factor another point, whose score is at least
    /// `margin` above its own, is faster (1: none is).
    pub fn times_slower(&self, point: &OperatingPoint, margin: f64) -> f64 {
        let as_good = self.points.iter().filter(|(_, other)| other.score >= point.score + margin);
        as_good.map(|(_, other)| point.frame_ms / other.frame_ms).fold(1.0, f64::max)
    }

    /// The point with given settings.
    pub fn find(&self, settings: &OperatingPoint) -> Option<&OperatingPoint> {
        let same = |o: &OperatingPoint| {
            let bare = |p: &OperatingPoint| OperatingPoint { frame_ms: 0.0, score: 0.0, samples: 0.0, ..*p };
            bare(o) == bare(settings) && (o.samples / settings.samples - 1.0).abs() < 0.02
        };
        self.points.iter().map(|(_, o)| o).find(|o| same(o))
    }
}

/// The points that all scenes have, with the geometric mean of their times and the mean of their scores.
pub fn merged(scenes: &[Measured]) -> Vec<OperatingPoint> {
    let Some(first) = scenes.first() else { return Vec::new() };
    let everywhere = |(name, point): &(String, OperatingPoint)| {
        let all: Option<Vec<&OperatingPoint>> =
            scenes.iter().map(|scene| scene.points.iter().find(|(n, _)| n == name).map(|(_, p)| p)).collect();
        let all = all?;
        let count = all.len() as f64;
        let logs: f64 = all.iter().map(|p| p.frame_ms.ln()).sum();
        let score = all.iter().map(|p| p.score).sum::<f64>() / count;
        Some(OperatingPoint { frame_ms: (logs / count).exp(), score, ..*point })
    };
    first.points.iter().filter_map(everywhere).collect()
}

/// How much of what can be gained between the fastest and the best point each preset has.
const GAINS: [f64; 3] = [0.0, 0.5, 0.95];

/// The text of each preset's file, by name: of the front, over all scenes, of the points that differ from the
/// given settings in samples and rays alone, the fastest that has the preset's share of what can be
/// gained; and the points for the budget controller, which moves between presets unseen.
///
/// # Errors
/// [`Error::Setting`] without points that all scenes have.
pub fn presets(scenes: &[Measured]) -> Result<Vec<(&'static str, String)>> {
    let points = merged(scenes);
    let best_of = |points: &[OperatingPoint]| {
        let values: Vec<(f64, f64)> = points.iter().map(|p| (p.frame_ms, p.score)).collect();
        let best = points.iter().zip(on_front(&values)).filter(|(_, best)| *best);
        let mut front: Vec<OperatingPoint> = best.map(|(p, _)| *p).collect();
        front.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
        front
    };
    let family: Vec<OperatingPoint> = points.iter().filter(|p| p.same_family(&points[0])).copied().collect();
    let (front, ladder) = (best_of(&points), best_of(&family));
    let (Some(worst), Some(best)) = (ladder.first().copied(), ladder.last().copied()) else {
        return Err(Error::setting("reports", "they have no points in common; measure the same sweep"));
    };
    let about = describe(scenes);
    let choose = |gain: f64| {
        let wanted = worst.score + gain * (best.score - worst.score);
        ladder.iter().copied().find(|p| p.score >= wanted).unwrap_or(best)
    };
    let names = preset::names();
    let files = names.iter().zip(GAINS).map(|(name, gain)| {
        let chosen = choose(gain);
        Ok((*name, file(name, gain, &about, &chosen, &with_ladder(&points, &front, &chosen))?))
    });
    files.collect()
}

fn describe(scenes: &[Measured]) -> String {
    let lines =
        scenes.iter().map(|s| format!("#   {}, {}x{}, on {}\n", s.scene, s.size[0], s.size[1], s.device));
    lines.collect()
}

fn file(
    name: &str,
    gain: f64,
    about: &str,
    chosen: &OperatingPoint,
    points: &[OperatingPoint],
) -> Result<String> {
    #[derive(Serialize)]
    struct Budget<'a> {
        front: &'a [OperatingPoint],
    }
    #[derive(Serialize)]
    struct File<'a> {
        foveation: Foveation,
        trace: Trace,
        reconstruction: Reconstruction,
        budget: Budget<'a>,
    }
    #[derive(Serialize)]
    struct Foveation {
        samples: f64,
        law: crate::foveation::Law,
    }
    #[derive(Serialize)]
    struct Trace {
        rays: u32,
        bounces: u32,
        edge_rays: u32,
    }
    #[derive(Serialize)]
    struct Reconstruction {
        method: crate::config::Method,
        k: u32,
        weights: crate::config::WeightsConfig,
    }
    let file = File {
        foveation: Foveation { samples: chosen.samples, law: chosen.law },
        trace: Trace { rays: chosen.rays, bounces: chosen.bounces, edge_rays: chosen.edge_rays },
        reconstruction: Reconstruction { method: chosen.method, k: chosen.k, weights: chosen.weights },
        budget: Budget { front: points },
    };
    let text =
        toml::to_string(&file).map_err(|e| Error::setting("preset", format!("it cannot be written: {e}")))?;
    Ok(format!(
        "# The preset \"{name}\": of samples and rays on the front over the scenes below, the fastest with\n\
         # {:.0} % of what can be gained between its ends: score {:.2} in {:.0} ms, means over the scenes. After it\n\
         # come the points along which a frame's time is held. Written by the test write_presets from:\n{about}\n{text}",
        gain * 100.0,
        chosen.score,
        chosen.frame_ms
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Layers};
    use std::path::Path;

    fn scene(factor: f64) -> Measured {
        let point = |i: i32| {
            let double = 2f64.powi(i);
            let base = OperatingPoint::of(&Config::default(), 1, 1.0, 0.0);
            let samples = 0.01 * double;
            (
                format!("{i}"),
                OperatingPoint { frame_ms: factor * double, score: 9.0 - 4.0 / double, samples, ..base },
            )
        };
        let mut points: Vec<_> = (0..6).map(point).collect();
        points.push(("bad".into(), OperatingPoint { score: 1.0, rays: 99, ..points[5].1 }));
        Measured { scene: format!("scene {factor}"), device: "a device".into(), size: [64, 32], points }
    }

    #[test]
    fn presets_are_points_of_the_common_front_and_can_be_loaded() {
        let scenes = [scene(1.0), scene(4.0)];
        let folder = tempfile::tempdir().unwrap();
        let mut last = 0.0;
        for (name, text) in presets(&scenes).unwrap() {
            let path = folder.path().join("preset.toml");
            std::fs::write(&path, &text).unwrap();
            let mut layers = Layers::default();
            layers.file(&path).unwrap();
            let config = layers.finish().unwrap();
            let chosen = OperatingPoint::of(&config, 1_000_000, 1.0, 0.0);
            for scene in &scenes {
                let found = scene.find(&chosen).unwrap_or_else(|| panic!("{name}: {text}"));
                assert_eq!(scene.times_slower(found, 0.0), 1.0);
                assert!(found.frame_ms >= last);
            }
            last = scenes[0].find(&chosen).unwrap().frame_ms;
            assert_eq!(config.budget.front.len(), 6, "{text}");
            assert!(text.contains("scene 4, 64x32, on a device"));
        }
        assert!(presets(&[]).is_err());
    }

    #[test]
    fn times_are_merged_by_their_geometric_mean() {
        let all = merged(&[scene(1.0), scene(4.0)]);
        assert_eq!(all.len(), 7);
        assert!((all[0].frame_ms - 2.0).abs() < 1e-9);
        assert_eq!(scene(1.0).times_slower(&scene(1.0).points[6].1, 0.0), 32.0);
    }

    fn root() -> &'static Path {
        Path::new(env!("CARGO_MANIFEST_DIR"))
    }

    /// Scores nearer than this are one: they move by as much from one gaze to the next.
    const SCORE_MARGIN: f64 = 0.05;

    #[test]
    fn presets_are_near_the_front_of_every_scene_that_was_measured() {
        let bytes = std::fs::read(root().join("configs/quality/measured.json")).unwrap();
        let scenes: Vec<Measured> = serde_json::from_slice(&bytes).unwrap();
        assert!(scenes.len() >= 3, "several scenes");
        let written = presets(&scenes).unwrap();
        let mut last = 0.0;
        for name in preset::names() {
            let config = preset::config(name).unwrap();
            let settings = OperatingPoint::of(&config, 1 << 24, 1.0, 0.0);
            let mut product = 1.0;
            for scene in &scenes {
                let found = scene.find(&settings).unwrap_or_else(|| panic!("{name} in {}", scene.scene));
                let slower = scene.times_slower(found, SCORE_MARGIN);
                println!(
                    "{name} in {}: {:.1} ms, score {:.2}, {slower:.2}",
                    scene.scene, found.frame_ms, found.score
                );
                assert!(
                    slower < 1.5,
                    "{name} in {}: another is as good in 1/{slower:.2} of the time",
                    scene.scene
                );
                product *= found.frame_ms;
            }
            assert!(product > last, "{name} is dearer than the one before");
            last = product;
            assert!(config.budget.front.len() >= 3, "{name} has points for the controller");
            let text = &written.iter().find(|(of, _)| *of == name).unwrap().1;
            let file = std::fs::read_to_string(root().join(format!("configs/quality/{name}.toml"))).unwrap();
            assert!(file == *text, "{name}.toml is not what measured.json says");
        }
        // A point that is no good is noticed.
        let worst = OperatingPoint { frame_ms: 1e9, score: 0.0, ..scenes[0].points[0].1 };
        assert!(scenes[0].times_slower(&worst, SCORE_MARGIN) > 1e3);
    }

    /// Run after scripts/measure-trade.sh, which leaves its reports in out/measure.
    #[test]
    #[ignore = "writes configs/quality from out/measure"]
    fn write_presets() {
        let mut reports: Vec<_> = std::fs::read_dir(root().join("out/measure"))
            .expect("out/measure; run scripts/measure-trade.sh")
            .map(|entry| entry.unwrap().path().join("report.json"))
            .filter(|path| path.exists())
            .collect();
        reports.sort();
        let read = |path: &std::path::PathBuf| -> Report {
            serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
        };
        let scenes: Vec<Measured> = reports.iter().map(|path| Measured::of(&read(path))).collect();
        let folder = root().join("configs/quality");
        let lines = serde_json::to_string(&scenes).unwrap().replace("],[", "],\n[") + "\n";
        std::fs::write(folder.join("measured.json"), &lines).unwrap();
        // Read back, so that the presets are those of the file to the last bit.
        let scenes: Vec<Measured> = serde_json::from_str(&lines).unwrap();
        for (name, text) in presets(&scenes).unwrap() {
            std::fs::write(folder.join(format!("{name}.toml")), text).unwrap();
        }
    }
}
