//! Yaw: which way is ahead, from the magnetic field.
//!
//! First the field and the hard iron are scouted for; then every block corrects yaw, the
//! gyroscope's zero and the calibration together. A block that the filter cannot explain is a
//! disturbance: yaw then holds by the gyroscopes, whose zero is well known by that time. A field
//! that stays different becomes a new reference, and the former one is taken back when it returns.

use super::calibration::{MagneticCalibration, Scout};
use super::magnetometer::Block;
use super::state::{FIELD, HARD, Row, SIZE, SOFT, State, TURN};
use glam::{DMat3, DQuat, DVec3};

/// Doubt about the soft iron's entries when nothing is known of them.
const SOFT_PRIOR: f64 = 0.05;
/// Standard deviation of a block as the filter takes it: fields in rooms differ from place to place,
/// and blocks are not independent; gauss.
const NOISE: f64 = 0.005;
/// The same for judging whether a block is explained; gauss.
const NOISE_TO_JUDGE: f64 = 0.003;
/// The same while yaw is in doubt by more than [`YAW_DOUBT`] rad: it is to be found soon.
const NOISE_TO_FIND: f64 = 0.004;
const YAW_DOUBT: f64 = 0.026;
/// Doubt about tilt at which the field says nothing about yaw, rad.
const TILT_DOUBT: f64 = 0.05;
/// Seconds after a hole for which yaw is suspected rather than the field.
const SUSPICION: f64 = 10.0;
/// Seconds for which a turn must explain the field before yaw is doubted, and the greatest such turn.
const TURNED: f64 = 1.0;
const GREATEST_TURN: f64 = 0.06;
/// Doubt that is then admitted: about yaw, rad, and about the gyroscope's zero, rad/s.
const TURN_DOUBT: f64 = 0.04;
const ZERO_DOUBT: f64 = 0.003;
/// The greatest sum of three squared normal residuals that is explained (99.9 %).
const EXPLAINED: f64 = 16.0;
/// Seconds of explained blocks after a disturbance before they are used again.
const PROBATION: f64 = 1.5;
/// Seconds of disturbance after which a steady field is the new reference.
const NEW_REFERENCE: f64 = 60.0;
/// Seconds over which it must be steady, and how steady, in gauss.
const STEADY: f64 = 10.0;
const STEADINESS: f64 = 0.015;
/// References that are kept.
const REFERENCES: usize = 4;
/// Doubt about yaw beyond which it is set by the field at once, rad.
const LOST: f64 = 0.15;
/// The doubt that is left when it was, rad.
const FOUND: f64 = 0.08;
/// How far strength and dip may differ for that, as a share of the field.
const LIKENESS: f64 = 0.2;

/// What the magnetometer is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YawSource {
    /// Nothing yet: it is being calibrated; the share that is done.
    Calibrating(f64),
    /// It corrects yaw.
    Magnetometer,
    /// Its field is disturbed; the gyroscopes hold yaw.
    Gyroscope,
}

/// Corrects yaw.
#[derive(Clone, Debug, Default)]
pub struct Yaw {
    scout: Scout,
    /// A calibration from an earlier run waits for the first block.
    kept: Option<MagneticCalibration>,
    calibrated: bool,
    disturbed_for: f64,
    turned_for: f64,
    /// Seconds for which yaw is suspected after a hole in the stream.
    suspected_for: f64,
    probation: f64,
    steady_for: f64,
    steady_field: DVec3,
    references: Vec<DVec3>,
}

impl Yaw {
    /// Starts from the calibration of an earlier run.
    pub fn with_calibration(calibration: MagneticCalibration) -> Self {
        Yaw { kept: calibration.is_credible().then_some(calibration), ..Yaw::default() }
    }

    /// What corrects yaw at present.
    pub fn source(&self) -> YawSource {
        match (self.calibrated, self.disturbed_for > 0.0 || self.probation > 0.0) {
            (false, _) => YawSource::Calibrating(self.scout.progress()),
            (true, false) => YawSource::Magnetometer,
            (true, true) => YawSource::Gyroscope,
        }
    }

    /// The calibration to keep; `None` while there is none.
    pub fn calibration(&self, state: &State) -> Option<MagneticCalibration> {
        let doubt = |at: usize| state.variance_of(at).sqrt().max(1e-4);
        let soft_doubt = (0..9).map(|entry| doubt(SOFT + entry)).fold(0.0, f64::max);
        self.calibrated.then(|| MagneticCalibration {
            hard_iron: state.hard,
            soft_iron: state.soft,
            hard_iron_doubt: DVec3::new(doubt(HARD), doubt(HARD + 1), doubt(HARD + 2)),
            soft_iron_doubt: soft_doubt,
        })
    }

    /// Takes up a block. `settled` is false while tilt is being found for the first time.
    ///
    /// Nothing is done while tilt is in doubt: the steep field would turn its error into yaw's.
    pub fn add(&mut self, state: &mut State, block: &Block, settled: bool) {
        state.propagate();
        let tilt = state.variance_of(TURN) + state.variance_of(TURN + 2);
        if !settled || (self.calibrated && tilt > TILT_DOUBT * TILT_DOUBT) {
            return;
        }
        if let Some(kept) = self.kept.take() {
            self.resume(state, block, &kept);
        } else if !self.calibrated {
            if self.scout.add(block, state.world_from_body) {
                self.begin(state);
            }
        } else {
            self.correct(state, block);
        }
    }

    /// Goes on from the scout. The direction in which the head faces now is the one that the field is
    /// related to, so that the doubt about yaw until now is of no more consequence.
    fn begin(&mut self, state: &mut State) {
        (state.field, state.hard, state.soft) = (self.scout.field(), self.scout.hard_iron(), DMat3::ZERO);
        state.set_variance(TURN + 1, 1e-6);
        for index in FIELD..SOFT + 9 {
            state.set_variance(index, SOFT_PRIOR * SOFT_PRIOR);
        }
        for (row, line) in self.scout.covariance().iter().enumerate() {
            for (column, value) in line.iter().enumerate() {
                state.set_covariance(FIELD + row, FIELD + column, *value);
            }
        }
        *self = Yaw { calibrated: true, ..Yaw::default() };
    }

    fn resume(&mut self, state: &mut State, block: &Block, kept: &MagneticCalibration) {
        (state.hard, state.soft) = (kept.hard_iron, kept.soft_iron);
        let Some(field) = world_field(state, block) else { return };
        state.field = field;
        for axis in 0..3 {
            state.set_variance(FIELD + axis, 1.0);
            state.set_variance(HARD + axis, kept.hard_iron_doubt[axis].max(0.002).powi(2));
        }
        for index in SOFT..SOFT + 9 {
            state.set_variance(index, kept.soft_iron_doubt.powi(2));
        }
        state.set_variance(TURN + 1, 1e-6);
        self.calibrated = true;
        take(state, block);
    }

    /// Says that the head may have turned unseen: for a while a field of the right strength and dip
    /// that points elsewhere is more likely an error of yaw than a disturbance.
    pub fn suspect(&mut self) {
        self.suspected_for = SUSPICION;
    }

    fn correct(&mut self, state: &mut State, block: &Block) {
        self.suspected_for = (self.suspected_for - block.seconds).max(0.0);
        if state.variance_of(TURN + 1) > LOST * LOST && find_yaw(state, block) {
            return;
        }
        let field = state.field;
        if surprise(state, block, field) < EXPLAINED {
            self.undisturbed(state, block);
        } else if self.suspected_for > 0.0 && resembles(state, block) && find_yaw(state, block) {
            (self.disturbed_for, self.probation) = (0.0, 0.0);
        } else if self.turned(state, block) {
            take(state, block);
        } else if let Some(index) = self.known_reference(state, block) {
            self.take_back(state, block, index);
        } else {
            self.disturbed(state, block);
        }
    }

    fn undisturbed(&mut self, state: &mut State, block: &Block) {
        self.probation = (self.probation - block.seconds).max(0.0);
        if self.probation > 0.0 {
            return;
        }
        (self.disturbed_for, self.turned_for) = (0.0, 0.0);
        self.scout = Scout::default();
        take(state, block);
    }

    /// True when for some time a small error of yaw has explained what the filter cannot: then it is too
    /// sure of the gyroscope's zero. A disturbance changes strength and dip as well, and soon exceeds
    /// a small turn.
    fn turned(&mut self, state: &mut State, block: &Block) -> bool {
        if !is_turned(state, block) {
            self.turned_for = 0.0;
            return false;
        }
        self.turned_for += block.seconds;
        if self.turned_for < TURNED {
            return false;
        }
        (self.turned_for, self.disturbed_for, self.probation) = (0.0, 0.0, 0.0);
        state.doubt_yaw(TURN_DOUBT, ZERO_DOUBT);
        true
    }

    fn known_reference(&self, state: &State, block: &Block) -> Option<usize> {
        self.references.iter().position(|&field| surprise(state, block, field) < EXPLAINED)
    }

    /// Counts the seconds for which a former reference explains the field, and returns to it.
    fn take_back(&mut self, state: &mut State, block: &Block, index: usize) {
        self.probation = (self.probation - block.seconds).max(0.0);
        if self.probation > 0.0 {
            return;
        }
        let former = std::mem::replace(&mut self.references[index], state.field);
        refer_to(state, former);
        self.disturbed_for = 0.0;
        take(state, block);
    }

    fn disturbed(&mut self, state: &mut State, block: &Block) {
        self.probation = PROBATION;
        self.disturbed_for += block.seconds;
        let recalibrated = self.scout.add(block, state.world_from_body);
        let Some(field) = world_field(state, block) else { return };
        if (field - self.steady_field).length() < STEADINESS {
            self.steady_for += block.seconds;
        } else {
            (self.steady_for, self.steady_field) = (0.0, field);
        }
        if self.disturbed_for < NEW_REFERENCE {
            return;
        }
        if is_alike(state.field, field) && find_yaw(state, block) {
            (self.disturbed_for, self.probation) = (0.0, 0.0);
        } else if self.steady_for > STEADY {
            self.references.insert(0, state.field);
            self.references.truncate(REFERENCES);
            let field = self.steady_field;
            refer_to(state, field);
            (self.disturbed_for, self.probation, self.steady_for) = (0.0, 0.0, 0.0);
            self.scout = Scout::default();
        } else if recalibrated {
            self.begin(state);
        }
    }
}

/// The block's field by the calibration, world frame; `None` if the calibration is singular.
fn world_field(state: &State, block: &Block) -> Option<DVec3> {
    let soft = DMat3::IDENTITY + state.soft;
    let body = (soft.determinant().abs() > 0.1).then(|| soft.inverse() * (block.field - state.hard))?;
    Some(state.world_from_body * body).filter(|field: &DVec3| field.is_finite())
}

/// Makes another field the reference, as well known as yaw is now.
fn refer_to(state: &mut State, field: DVec3) {
    let yaw = state.variance_of(TURN + 1);
    let across = field.x.powi(2) + field.z.powi(2);
    state.field = field;
    for axis in 0..3 {
        state.set_variance(FIELD + axis, NOISE * NOISE + yaw * across);
    }
}

/// Residuals of a block and how they depend on the errors.
fn measure(state: &State, block: &Block, field: DVec3) -> [(f64, Row); 3] {
    let soft = DMat3::IDENTITY + state.soft;
    let inner = block.body_from_world * field;
    let residual = block.field - soft * inner - state.hard;
    let by_field = soft * block.body_from_world;
    let cross = DMat3::from_cols(
        DVec3::new(0.0, field.z, -field.y),
        DVec3::new(-field.z, 0.0, field.x),
        DVec3::new(field.y, -field.x, 0.0),
    );
    let by_turn = by_field * cross;
    std::array::from_fn(|axis| {
        let mut jacobian = [0.0; SIZE];
        for column in 0..3 {
            jacobian[TURN + column] = by_turn.col(column)[axis];
            jacobian[FIELD + column] = by_field.col(column)[axis];
            jacobian[SOFT + 3 * axis + column] = inner[column];
        }
        jacobian[HARD + axis] = 1.0;
        (residual[axis], jacobian)
    })
}

/// The sum of the squared residuals, each by its expected variance.
fn surprise(state: &State, block: &Block, field: DVec3) -> f64 {
    let noise = NOISE_TO_JUDGE.powi(2) + block.smear.powi(2);
    let normal = |(residual, jacobian): &(f64, Row)| residual * residual / (state.variance(jacobian) + noise);
    measure(state, block, field).iter().map(normal).sum()
}

/// True when a small turn about the vertical explains a block.
fn is_turned(state: &State, block: &Block) -> bool {
    let rows = measure(state, block, state.field);
    let by_yaw = DVec3::from_array([0, 1, 2].map(|axis| rows[axis].1[TURN + 1]));
    let residual = DVec3::from_array([0, 1, 2].map(|axis| rows[axis].0));
    let turn = by_yaw.dot(residual) / by_yaw.length_squared().max(1e-9);
    let rest = residual - turn * by_yaw;
    let noise = NOISE_TO_JUDGE.powi(2) + block.smear.powi(2);
    let surprise: f64 = (0..3).map(|axis| rest[axis].powi(2) / (state.variance(&rows[axis].1) + noise)).sum();
    turn.abs() < GREATEST_TURN && surprise < EXPLAINED
}

fn take(state: &mut State, block: &Block) {
    let doubtful = state.variance_of(TURN + 1) > YAW_DOUBT * YAW_DOUBT;
    let base: f64 = if doubtful { NOISE_TO_FIND } else { NOISE };
    let noise = base.powi(2) + block.smear.powi(2);
    let field = state.field;
    let measurements = measure(state, block, field).map(|(residual, jacobian)| (residual, jacobian, noise));
    state.update(&measurements, |index| index == TURN || index == TURN + 2);
}

/// True when a block's field has the reference's strength and dip.
fn resembles(state: &State, block: &Block) -> bool {
    world_field(state, block).is_some_and(|field| is_alike(state.field, field))
}

/// True when two fields have the same strength and dip: then it is yaw that was lost.
fn is_alike(a: DVec3, b: DVec3) -> bool {
    (a.x.hypot(a.z) - b.x.hypot(b.z)).abs() < STEADINESS && (a.y - b.y).abs() < STEADINESS
}

/// Sets yaw by the field after it was lost, if the field is the reference's in strength and dip.
fn find_yaw(state: &mut State, block: &Block) -> bool {
    let Some(found) = world_field(state, block) else { return false };
    let field = state.field;
    let [known, seen] = [field, found].map(|f| f.x.hypot(f.z));
    let limit = LIKENESS * field.length();
    if (known - seen).abs() > limit || (found.y - field.y).abs() > limit || known < limit {
        return false;
    }
    let turn = field.x.atan2(field.z) - found.x.atan2(found.z);
    state.world_from_body = (DQuat::from_rotation_y(turn) * state.world_from_body).normalize();
    state.set_variance(TURN + 1, FOUND * FOUND);
    true
}
