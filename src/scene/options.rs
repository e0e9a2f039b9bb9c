//! How a scene is loaded, where not as usual.

use std::fmt;

use super::animation::Choice;
use super::budget::Budget;
use super::grab::Grab;
use super::instanced::Instancing;

/// What a caller may want of a scene's file.
#[derive(Debug)]
pub struct LoadOptions {
    /// The scene to show, by name or by number from 0; the file's own choice by default.
    pub scene: Option<String>,
    /// The camera that views start from, by name or by number from 0.
    pub camera: Option<String>,
    /// The variant of its materials, by name or by number from 0 (KHR_materials_variants).
    pub variant: Option<String>,
    /// The animations that play; none by default.
    pub animation: Choice,
    /// Seconds for which they have played.
    pub time: f64,
    /// Whether the scene is to move on from there ([`super::Scene::motion`]).
    pub keeps_motion: bool,
    /// What hands can seize there; nothing by default, and in what does not move on.
    pub grab: Grab,
    /// Which shapes are kept once.
    pub instancing: Instancing,
    /// Metres that a unit of the file is.
    pub scale: f64,
    /// Memory that it may take.
    pub budget: Budget,
    /// Is told how far loading is.
    pub progress: Progress,
}

impl Default for LoadOptions {
    /// For the machine's free memory.
    fn default() -> Self {
        let (budget, progress) = (Budget::of_machine(), Progress::default());
        let (animation, time) = (Choice::None, 0.0);
        LoadOptions {
            scene: None,
            camera: None,
            variant: None,
            animation,
            time,
            keeps_motion: false,
            grab: Grab::None,
            instancing: Instancing::default(),
            scale: 1.0,
            budget,
            progress,
        }
    }
}

/// Somebody who is told the share of the work that is done, 0 to 1, of files that take long.
#[derive(Default)]
pub struct Progress(Option<Box<dyn Fn(f64) + Send + Sync>>);

impl Progress {
    /// Tells `listener`.
    pub fn to(listener: impl Fn(f64) + Send + Sync + 'static) -> Self {
        Progress(Some(Box::new(listener)))
    }

    /// Tells that so much is done.
    pub fn tell(&self, done: f64) {
        if let Some(listener) = &self.0 {
            listener(done);
        }
    }
}

impl fmt::Debug for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "Progress(listener)" } else { "Progress" })
    }
}

/// The index of what is asked for by its name or its number; a clause that lists what is there, where it is not.
pub(super) fn by_name(names: &[&str], wanted: &str, kind: &str) -> Result<usize, String> {
    const TOLD: usize = 12;
    let number = || wanted.parse::<usize>().ok().filter(|&number| number < names.len());
    names.iter().position(|name| *name == wanted).or_else(number).ok_or_else(|| {
        let told: Vec<String> =
            names.iter().enumerate().take(TOLD).map(|(i, name)| format!("{i} ({name:?})")).collect();
        let more = if names.len() > TOLD { ", and more" } else { "" };
        match told.is_empty() {
            true => format!("it has no {kind}s, and {wanted:?} is asked for; leave that out"),
            false => format!("it has no {kind} {wanted:?}; give one of {}{more}", told.join(", ")),
        }
    })
}
