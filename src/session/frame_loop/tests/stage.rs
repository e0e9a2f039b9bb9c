//! A headset, a renderer and a listener that write down what they are asked.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::LazyLock;

use glam::{DMat4, DQuat, DVec3};

use super::*;
use crate::frame::StageMs;
use crate::headset::{Deadline, Gaze, HiddenMesh, Toggles};
use crate::scene::generate::demo;
use crate::scene::hands::HandPlaces;

/// Nanoseconds between pictures of the display.
pub const PERIOD: i64 = 10_000_000;
pub const FOV: FieldOfView = FieldOfView { left: -1.2, right: 0.7, up: 0.9, down: -1.0 };
pub const SIZE: (u32, u32) = (120, 90);

pub static SCENE: LazyLock<Scene> =
    LazyLock::new(|| Scene::from_glb(std::path::Path::new("demo"), &demo::generate()).unwrap());

/// A head that moves all the time, before a display of its own clock.
pub struct Wearer {
    pub clock: Rc<Cell<i64>>,
    /// The last frame's time.
    pub last: i64,
    /// Where the eyes look at a time, if they are followed: to the right, in radians.
    pub gaze: Option<fn(i64) -> f64>,
    pub input: Input,
    pub visible: bool,
    pub surprises: bool,
    pub located: Vec<i64>,
    /// When each frame was ended, and the views that it showed.
    pub ended: Vec<(i64, Option<Vec<EyeView>>)>,
    /// Frames for which the last picture stayed.
    pub held: u32,
    /// What was told meanwhile.
    pub told: Vec<String>,
    pub status: String,
}

/// Where the eyes are at a time.
pub fn eyes(time: i64) -> Vec<EyeView> {
    let seconds = time as f64 * 1e-9;
    let head =
        Pose::new(DQuat::from_rotation_y(0.3 * seconds), DVec3::new(seconds, 1.6 + 0.1 * seconds, 0.0));
    let mirrored = FieldOfView { left: -FOV.right, right: -FOV.left, ..FOV };
    let eye = |x, fov| EyeView {
        space_from_eye: head.then(Pose { position: DVec3::X * x, ..Pose::IDENTITY }),
        fov,
    };
    vec![eye(-0.032, FOV), eye(0.032, mirrored)]
}

impl Headset for Wearer {
    fn next_frame(&mut self) -> Outcome<Next> {
        // Waits for a beat that is not another frame's, until a period before it.
        let time = (self.last + PERIOD).max(self.clock.get() / PERIOD * PERIOD + PERIOD);
        self.last = time;
        self.clock.set(self.clock.get().max(time - PERIOD));
        Ok(Next::Frame(Frame { time, should_render: self.visible, began: Instant::now() }))
    }

    fn sizes(&self) -> Vec<(u32, u32)> {
        vec![SIZE; 2]
    }

    fn now(&self) -> i64 {
        self.clock.get()
    }

    fn deadline(&self, frame: &Frame) -> Deadline {
        Deadline { time: frame.time, period: Some(PERIOD) }
    }

    fn locate(&mut self, time: i64) -> Outcome<Option<Vec<EyeView>>> {
        self.located.push(time);
        Ok(Some(eyes(time)))
    }

    fn surprises(&self) -> bool {
        self.surprises
    }

    fn input(&mut self, time: i64) -> Outcome<Input> {
        let look = |right: f64| {
            let direction =
                eyes(time)[0].space_from_eye.rotation * DVec3::new(right.sin(), 0.0, -right.cos());
            Gaze { time, direction, valid: true }
        };
        Ok(Input { gaze: self.gaze.map(|right| look(right(time))), ..self.input })
    }

    fn acquire(&mut self) -> Outcome<Option<Vec<Canvas>>> {
        Ok(Some(Vec::new()))
    }

    fn end(&mut self, _: &Frame, shown: Option<&[EyeView]>) -> Outcome<()> {
        self.ended.push((self.clock.get(), shown.map(<[EyeView]>::to_vec)));
        Ok(())
    }

    fn hold(&mut self, frame: &Frame, why: Option<&str>) -> Outcome<()> {
        self.held += 1;
        self.told.extend(why.map(str::to_string));
        self.end(frame, None)
    }

    fn describe(&mut self, status: String) {
        self.status = status;
    }

    fn hidden(&self) -> (&[HiddenMesh], u64) {
        (&[], 0)
    }
}

/// Writes down what it was to draw, and takes its time.
pub struct Notebook {
    pub clock: Rc<Cell<i64>>,
    /// Nanoseconds that tracing a view takes.
    pub cost: i64,
    /// Pictures for which a driver builds kernels, which takes far longer than their rays.
    pub building: usize,
    /// Whether samples take turns in all pictures.
    pub rests: bool,
    pub drawn: Vec<Drawn>,
    /// At which instants of the scene.
    pub instants: Vec<f64>,
    /// And with which hands.
    pub hands: Vec<HandPlaces>,
    /// And where hands have put what they can seize.
    pub put: Vec<Vec<Option<DMat4>>>,
    pub applied: usize,
    pub toggled: [usize; 2],
}

pub struct Drawn {
    pub traced: Vec<Traced>,
    pub seed: u32,
    pub exposure: f32,
    /// Where the views' eyes were said to be, once they were traced.
    pub late: Vec<Option<Pose>>,
}

impl Draw for Notebook {
    fn draw(
        &mut self,
        picture: &Picture,
        late: &mut dyn FnMut(usize) -> Option<Pose>,
    ) -> Result<FrameReport> {
        let mut drawn = Drawn {
            traced: picture.traced.to_vec(),
            seed: picture.seed,
            exposure: picture.exposure,
            late: Vec::new(),
        };
        for index in 0..picture.traced.len() {
            self.clock.set(self.clock.get() + self.cost);
            drawn.late.push(late(index));
        }
        self.clock.set(self.clock.get() + self.cost / 8);
        let frame_ms = 2.0 * self.cost as f64 * 1e-6;
        let rays = if self.drawn.len() < self.building { 0.1 } else { 0.6 };
        let stages =
            StageMs { trace: rays / 3.0 * frame_ms, shade: rays / 1.5 * frame_ms, ..StageMs::default() };
        self.drawn.push(drawn);
        Ok(FrameReport { frame_ms, stages, rests: self.rests, ..FrameReport::default() })
    }

    fn set_quality(&mut self, _: &Quality) -> Result<()> {
        self.applied += 1;
        Ok(())
    }

    fn show_at(&mut self, seconds: f64) {
        self.instants.push(seconds);
    }

    fn show_hands(&mut self, hands: &HandPlaces) {
        self.hands.push(*hands);
    }

    fn put(&mut self, places: &[Option<DMat4>]) {
        self.put.push(places.to_vec());
    }

    fn toggle(&mut self, toggles: Toggles) {
        self.toggled[0] += usize::from(toggles.exposure);
        self.toggled[1] += usize::from(toggles.overlay);
    }

    fn take_notes(&mut self) -> Vec<String> {
        Vec::new()
    }
}

/// A notebook that has no device for some pictures.
pub struct Absent<'n> {
    pub notebook: &'n mut Notebook,
    pub missed: usize,
}

impl Draw for Absent<'_> {
    fn draw(
        &mut self,
        picture: &Picture,
        late: &mut dyn FnMut(usize) -> Option<Pose>,
    ) -> Result<FrameReport> {
        if self.missed == 0 {
            return self.notebook.draw(picture, late);
        }
        self.missed -= 1;
        Err(Error::NoDevice { kind: "OpenCL", problem: "none is left".into() })
    }

    fn set_quality(&mut self, quality: &Quality) -> Result<()> {
        self.notebook.set_quality(quality)
    }

    fn show_at(&mut self, seconds: f64) {
        self.notebook.show_at(seconds);
    }

    fn show_hands(&mut self, hands: &HandPlaces) {
        self.notebook.show_hands(hands);
    }

    fn put(&mut self, places: &[Option<DMat4>]) {
        self.notebook.put(places);
    }

    fn toggle(&mut self, toggles: Toggles) {
        self.notebook.toggle(toggles);
    }

    fn take_notes(&mut self) -> Vec<String> {
        self.notebook.take_notes()
    }
}

/// Hears everything.
#[derive(Default)]
pub struct Listener {
    pub notes: Vec<String>,
    pub shown: Vec<Shown>,
}

impl Observer for Listener {
    fn note(&mut self, sentence: &str) {
        self.notes.push(sentence.to_string());
    }

    fn shown(&mut self, shown: Shown) -> Result<()> {
        self.shown.push(shown);
        Ok(())
    }
}

/// What came of some frames.
pub struct Run {
    pub wearer: Wearer,
    pub notebook: Notebook,
    pub listener: Listener,
}

pub fn per_eye() -> Config {
    let mut config = Config::default();
    config.view.stereo = Stereo::PerEye;
    config.budget.target_ms = crate::config::TargetMs::None;
    config
}

/// Frames whose views take `cost` nanoseconds each.
pub fn frames(config: &Config, cost: i64, count: usize, change: impl FnOnce(&mut Wearer)) -> Run {
    let clock = Rc::new(Cell::new(1000 * PERIOD));
    let mut run = Run {
        wearer: Wearer {
            clock: clock.clone(),
            last: 0,
            gaze: None,
            input: Input::default(),
            held: 0,
            told: Vec::new(),
            visible: true,
            surprises: true,
            located: Vec::new(),
            ended: Vec::new(),
            status: String::new(),
        },
        notebook: Notebook {
            clock,
            cost,
            building: 0,
            rests: false,
            drawn: Vec::new(),
            instants: Vec::new(),
            hands: Vec::new(),
            put: Vec::new(),
            applied: 0,
            toggled: [0; 2],
        },
        listener: Listener::default(),
    };
    change(&mut run.wearer);
    go_on(&mut run, config, count);
    run
}

/// So many frames of a loop that begins.
pub fn go_on(run: &mut Run, config: &Config, count: usize) {
    let mut frame_loop = FrameLoop::new(config, &SCENE, Rig::in_place(), None, None);
    for _ in 0..count {
        let mut link =
            Link { headset: &mut run.wearer, draw: &mut run.notebook, observer: &mut run.listener };
        assert!(frame_loop.step(&mut link, &Keys::default()).unwrap());
    }
}

/// When a picture is seen that was handed over at a time: at the next beat of the display.
pub fn beat(handed_over: i64) -> i64 {
    (handed_over + PERIOD - 1) / PERIOD * PERIOD
}

pub fn close(a: Pose, b: Pose) -> bool {
    (a.position - b.position).length() < 1e-9 && a.rotation.angle_between(b.rotation) < 1e-6
}
