//! What is measured: the settings that were given, and others around them.

use super::effort::Effort;
use crate::config::{Config, Method, Samples, Stereo, WeightsConfig};
use crate::foveation::Law;
use crate::trace::Traversal;

/// One way to make frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Short and unique.
    pub name: String,
    /// The slider by which it differs from the settings that were given, or what kind of thing it is.
    pub axis: &'static str,
    /// How its frames are made.
    pub means: Means,
}

/// How frames are made.
#[derive(Clone, Debug, PartialEq)]
pub enum Means {
    /// By this program.
    Own(Box<Config>),
    /// By this program, traced from where the eyes were a frame before the picture is shown, as a headset
    /// gets it.
    Late {
        /// Settings.
        config: Box<Config>,
        /// Pixels are moved to where they are seen from when the picture is shown.
        corrected: bool,
    },
    /// A sample at each pixel, with fewer rays in zones farther from the gaze: up to 10 degrees, up to
    /// 20, and beyond.
    Zones {
        /// Rays in each.
        rays: [u32; 3],
    },
    /// Quad views: all of the view coarsely, and a rectangle around the gaze finely; one sample a pixel.
    Inset {
        /// What both resolutions are multiplied by.
        scale: f64,
    },
    /// One sample a pixel at a lower resolution.
    Coarse {
        /// What the resolution is multiplied by.
        scale: f64,
    },
}

/// The axis of the settings that were given.
pub const GIVEN: &str = "given";
/// The axis of combinations of samples and rays.
pub const GRID: &str = "samples and rays";
/// The axis of what others do.
pub const RIVAL: &str = "rival";
/// The axis of the kernels' variants.
pub const TRAVERSAL: &str = "traversal";
/// The axis of pictures that are shown a frame after the pose that they were traced at.
pub const LATE: &str = "late correction";

impl Candidate {
    /// The settings of what this program makes; none for what others do.
    pub fn config(&self) -> Option<&Config> {
        match &self.means {
            Means::Own(config) | Means::Late { config, .. } => Some(config),
            _ => None,
        }
    }
}

/// Everything to measure except what others do, the given settings first. `traversals` are the kernels' variants
/// that the devices do not use with the given settings.
pub fn candidates(base: &Config, effort: Effort, traversals: &[Traversal]) -> Vec<Candidate> {
    let mut list = vec![own("as given", GIVEN, base.clone())];
    let mut add = |name: String, axis, change: &dyn Fn(&mut Config)| {
        let mut config = base.clone();
        change(&mut config);
        let candidate = own(&name, axis, config);
        // A slider's given value is measured once.
        let new = list.iter().all(|c| c.means != candidate.means && c.name != candidate.name);
        if new {
            list.push(candidate);
        }
    };
    for &share in effort.samples() {
        add(format!("samples {share}"), "samples", &|c| c.foveation.samples = Samples::Share(share));
    }
    for &rays in effort.rays() {
        add(format!("rays {rays}"), "rays", &|c| c.trace.rays = rays);
    }
    for &share in effort.samples() {
        for &rays in effort.rays() {
            add(format!("samples {share}, rays {rays}"), GRID, &|c| {
                c.foveation.samples = Samples::Share(share);
                c.trace.rays = rays;
            });
        }
    }
    for (name, law) in laws(effort) {
        add(format!("law {name}"), "law", &|c| c.foveation.law = law);
    }
    for (name, method) in [("k-nn", Method::KNearest), ("guided", Method::Guided)] {
        add(format!("reconstruction {name}"), "reconstruction", &|c| c.reconstruction.method = method);
    }
    let ks: &[u32] = if effort == Effort::Quick { &[8] } else { &[1, 2, 8, 16] };
    for &k in ks {
        add(format!("k {k}"), "k", &|c| c.reconstruction.k = k);
    }
    for (name, weights) in [("gaussian", WeightsConfig::Gaussian), ("inverse", WeightsConfig::Inverse)] {
        add(format!("weights {name}"), "weights", &|c| c.reconstruction.weights = weights);
    }
    let edges: &[u32] = if effort == Effort::Quick { &[0] } else { &[0, 1, 2, 4, 8] };
    for &rays in edges {
        add(format!("edge rays {rays}"), "edge rays", &|c| c.trace.edge_rays = rays);
    }
    for (name, stereo) in [("shared", Stereo::Shared), ("per-eye", Stereo::PerEye)] {
        if base.view.stereo != Stereo::Mono {
            add(format!("stereo {name}"), "stereo", &|c| c.view.stereo = stereo);
        }
    }
    for &bounces in bounces(effort) {
        add(format!("bounces {bounces}"), "bounces", &|c| c.trace.bounces = bounces);
    }
    for &traversal in traversals {
        add(format!("traversal {}", traversal.name()), TRAVERSAL, &|c| c.trace.traversal = traversal.into());
    }
    for (name, corrected) in [("off", false), ("on", true)] {
        let means = Means::Late { config: Box::new(base.clone()), corrected };
        list.push(Candidate { name: format!("{LATE} {name}"), axis: LATE, means });
    }
    list
}

fn own(name: &str, axis: &'static str, config: Config) -> Candidate {
    Candidate { name: name.to_string(), axis, means: Means::Own(Box::new(config)) }
}

/// Numbers of bounces besides the given one. Each needs a reference of its own, so a quick run has none.
fn bounces(effort: Effort) -> &'static [u32] {
    match effort {
        Effort::Quick => &[],
        Effort::Usual => &[0, 1],
        Effort::Thorough => &[0, 1, 2],
    }
}

fn laws(effort: Effort) -> Vec<(&'static str, Law)> {
    let paper = |exponent| Law::Paper { exponent, centre_area: 1.0 / 15.0 };
    let mar = |slope| Law::LinearMar { slope, w0: 1.0 / 48.0 };
    let all = vec![
        ("uniform", Law::Uniform),
        ("paper -2/3", paper(-2.0 / 3.0)),
        ("paper -5/3", paper(-5.0 / 3.0)),
        ("linear-mar 0.022", mar(0.022)),
        ("paper -1", paper(-1.0)),
        ("linear-mar 0.0275", mar(0.0275)),
        ("log-polar 4", Law::LogPolar { alpha: 4.0 }),
        ("paper -4/3", paper(-4.0 / 3.0)),
        ("paper -7/3", paper(-7.0 / 3.0)),
        ("linear-mar 0.01", mar(0.01)),
        ("log-polar 2", Law::LogPolar { alpha: 2.0 }),
    ];
    let count = [4, 7, all.len()][effort as usize];
    all.into_iter().take(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_candidate_is_named_once_and_differs_from_the_rest() {
        let mut config = Config::default();
        config.view.stereo = Stereo::PerEye;
        for effort in [Effort::Quick, Effort::Usual, Effort::Thorough] {
            let list = candidates(&config, effort, &[Traversal::SingleRay]);
            let names: HashSet<&str> = list.iter().map(|c| c.name.as_str()).collect();
            assert_eq!(names.len(), list.len());
            assert_eq!(list[0].axis, GIVEN);
            for (index, candidate) in list.iter().enumerate() {
                assert!(list[..index].iter().all(|c| c.means != candidate.means), "{}", candidate.name);
            }
            let axes =
                ["samples", "rays", GRID, "law", "reconstruction", "k", "weights", "edge rays", "stereo"];
            for axis in axes.into_iter().chain([TRAVERSAL, LATE]) {
                assert!(list.iter().any(|c| c.axis == axis), "{effort:?} sweeps {axis}");
            }
            assert_eq!(list.iter().any(|c| c.axis == "bounces"), effort != Effort::Quick);
        }
    }
}
