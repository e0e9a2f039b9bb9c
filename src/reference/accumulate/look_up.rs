//! What a kept frame has of a point.

use glam::{DVec2, DVec3};

use super::toward::Toward;
use super::{
    Before, ELSEWHERE, ENOUGH_ON_SIDE, History, Kept, LEAST_AGREEMENT, MOVING_LONGEST, MOVING_TURN, Motion,
    OTHER_SIDE, SAME_PLACE, Sample, Settings, offset, pixel_width, point_of, toward, usable,
};
use crate::math::view::View;
use crate::reference::reconstruct::{Neighbour, nearest};

/// How well two points agree to lie on one surface: see `kernels/shared/records.wgsl`.
pub(super) fn agreement(
    point: DVec3,
    normal: DVec3,
    there: DVec3,
    other: DVec3,
    width: f64,
    settings: &Settings,
) -> f64 {
    let (off, tolerance) = (there - point, settings.plane_tolerance);
    let distance = normal.dot(off);
    let forgiven = tolerance * tolerance * off.length_squared() + width * width;
    (settings.normal_power * (normal.dot(other) - 1.0) - distance * distance / forgiven).exp()
}

fn by_distance(at: [u32; 2], from: DVec2) -> f64 {
    let off = DVec2::new(f64::from(at[0]), f64::from(at[1])) - from;
    (off.length_squared() + SAME_PLACE).powi(-2)
}

fn alike_reflection(point: DVec3, offset: DVec3, roughness: f64) -> f64 {
    let turned = 2.0 * (point.normalize() - (point + offset).normalize()).length();
    (-(turned / (roughness * roughness + 0.01)).powi(2)).exp()
}

fn alike_after_motion(now: (DVec3, DVec3), was: (DVec3, DVec3), roughness: f64) -> f64 {
    let mirrored = |(point, normal): (DVec3, DVec3)| point.normalize().reflect(normal);
    let turned = 2.0 * (mirrored(now) - mirrored(was)).length();
    (-(turned / (roughness * roughness + 0.01)).powi(2)).exp()
}

pub(super) fn before(kept: &Kept, view: &View, sample: &Sample, point: DVec3, settings: &Settings) -> Before {
    let (back, normal) = (offset(view, &kept.view), sample.normal);
    let still = Before {
        point: point + back,
        normal,
        longest: settings.longest,
        alike_reflection: alike_reflection(point, back, sample.roughness),
    };
    let last_from_now = match sample.motion {
        Motion::Still => return still,
        Motion::Unknown => return Before { longest: 1.0, alike_reflection: 0.0, ..still },
        Motion::Whole(matrix) => matrix,
    };
    let was = last_from_now.transform_point3(point + view.world_from_eye.position);
    let was = (
        was - kept.view.world_from_eye.position,
        last_from_now.transform_vector3(normal).normalize_or(normal),
    );
    let is_elsewhere = (was.0 - still.point).length() > ELSEWHERE * pixel_width(view, sample) * sample.depth;
    let most = if is_elsewhere { settings.longest.min(MOVING_LONGEST) } else { settings.longest };
    Before {
        point: was.0,
        normal: was.1,
        longest: (MOVING_TURN / (was.1 - normal).length()).clamp(1.0, most),
        alike_reflection: alike_after_motion((point, normal), was, sample.roughness),
    }
}

/// The samples of a kept frame that lie around a point on its surface, relative to its eye: index, agreement and weight of
/// each.
fn around(
    kept: &Kept,
    view: &View,
    sample: &Sample,
    (seen, normal): (DVec3, DVec3),
    settings: &Settings,
) -> Vec<(usize, f64, f64)> {
    let Some(at) = kept.view.project(kept.view.world_from_eye.rotation.inverse() * seen) else {
        return Vec::new();
    };
    let size = DVec2::new(f64::from(kept.view.width), f64::from(kept.view.height));
    if at.cmplt(DVec2::ZERO).any() || at.cmpge(size).any() {
        return Vec::new();
    }
    let positions: Vec<[u32; 2]> = kept.samples.iter().map(|sample| sample.at).collect();
    let pixel = [at.x as u32, at.y as u32];
    let width = pixel_width(view, sample) * sample.depth;
    let weighed = |near: Neighbour| {
        let other = &kept.samples[near.sample];
        let agree = match usable(other) {
            true => agreement(seen, normal, point_of(&kept.view, other), other.normal, width, settings),
            false => 0.0,
        };
        (near.sample, agree, agree * by_distance(other.at, at - 0.5))
    };
    nearest(&positions, pixel, settings.k)
        .into_iter()
        .map(weighed)
        .filter(|(.., weight)| *weight > 0.0)
        .collect()
}

fn agreed(found: &[(usize, f64, f64)]) -> f64 {
    found.iter().map(|(_, agree, _)| *agree).fold(0.0, f64::max)
}

/// What the last frame has for a point.
pub(super) struct Found {
    pub diffuse: DVec3,
    pub specular: DVec3,
    pub toward: Toward,
    /// Whether the sample that counts most knows where its light comes from.
    pub directed: bool,
    pub blocker: f64,
    pub history: History,
}

/// What the other eye has: `weights` tells how many estimates of diffuse and of specular light it is worth.
#[derive(Default)]
pub(super) struct Lent {
    pub diffuse: DVec3,
    pub specular: DVec3,
    pub toward: Toward,
    pub weights: [f64; 2],
}

/// The weighted mean of where samples' light comes from.
fn mean_toward(kept: &Kept, found: &[(usize, f64, f64)]) -> Toward {
    let sum: f64 = found.iter().map(|(.., weight)| weight).sum();
    toward::sum(found.iter().map(|&(index, _, weight)| (weight / sum, toward::of(&kept.samples[index]))))
}

pub(super) fn look_back(
    kept: &Kept,
    view: &View,
    sample: &Sample,
    past: &Before,
    settings: &Settings,
) -> Option<Found> {
    let found = around(kept, view, sample, (past.point, past.normal), settings);
    if agreed(&found) <= LEAST_AGREEMENT {
        return None;
    }
    let is_same_side = |index: usize| kept.samples[index].sun_centre == sample.sun_centre;
    let on_side = |&&(index, ..): &&(usize, f64, f64)| is_same_side(index);
    let most = found.iter().max_by(|a, b| a.2.total_cmp(&b.2));
    let directed = most.is_some_and(|&(index, ..)| kept.samples[index].toward.is_some());
    let near: f64 = found.iter().map(|(.., weight)| weight).sum();
    let side_sum: f64 = found.iter().filter(on_side).map(|(.., weight)| weight).sum();
    let (known, shadow) = found.iter().fold((0.0, 0.0), |(known, sum), &(index, _, weight)| {
        let weight = weight * kept.histories[index].confidence;
        (known + weight, sum + weight * kept.samples[index].blocker)
    });
    let shadow = if known > 0.0 { shadow / known } else { 0.0 };
    let weighed = |&(index, agree, weight): &(usize, f64, f64)| {
        (index, agree, weight * if is_same_side(index) || !settings.light_changes { 1.0 } else { OTHER_SIDE })
    };
    let found: Vec<(usize, f64, f64)> = found.iter().map(weighed).collect();
    let sum: f64 = found.iter().map(|(.., weight)| weight).sum();
    let mean = |value: &dyn Fn(usize) -> f64| {
        found.iter().map(|&(index, _, weight)| weight * value(index)).sum::<f64>() / sum
    };
    let color = |value: &dyn Fn(usize) -> DVec3| {
        found.iter().map(|&(index, _, weight)| value(index) * weight).sum::<DVec3>() / sum
    };
    let on_side = (side_sum / (ENOUGH_ON_SIDE * near)).min(1.0);
    let believed = if settings.light_changes { on_side } else { 1.0 };
    let history = History {
        ages: [0, 1].map(|part| believed * mean(&|index| kept.histories[index].ages[part])),
        fast: mean(&|index| kept.histories[index].fast),
        slow: mean(&|index| kept.histories[index].slow),
        variance: mean(&|index| kept.histories[index].variance),
        confidence: known / near,
    };
    let (diffuse, specular) =
        (color(&|index| kept.samples[index].diffuse), color(&|index| kept.samples[index].specular));
    let toward = mean_toward(kept, &found);
    Some(Found { diffuse, specular, toward, directed, blocker: shadow, history })
}

/// What the same sample had in the last frame, whose pattern was the same.
pub(super) fn what_it_had(kept: &Kept, index: usize) -> Option<Found> {
    let had = kept.samples.get(index).filter(|had| usable(had))?;
    Some(Found {
        diffuse: had.diffuse,
        specular: had.specular,
        toward: toward::of(had),
        directed: had.toward.is_some(),
        blocker: had.blocker,
        history: kept.histories[index],
    })
}

/// Diffuse and specular light of the other eye, and what they are worth.
pub(super) fn look_across(
    kept: &Kept,
    view: &View,
    sample: &Sample,
    point: DVec3,
    settings: &Settings,
) -> Option<Lent> {
    let found = around(kept, view, sample, (point + offset(view, &kept.view), sample.normal), settings);
    let agreed = agreed(&found);
    if agreed <= LEAST_AGREEMENT {
        return None;
    }
    let sum: f64 = found.iter().map(|(.., weight)| weight).sum();
    let color = |value: &dyn Fn(usize) -> DVec3| {
        found.iter().map(|&(index, _, weight)| value(index) * weight).sum::<DVec3>() / sum
    };
    let alike = alike_reflection(point, offset(view, &kept.view), sample.roughness);
    let (diffuse, specular) =
        (color(&|index| kept.samples[index].diffuse), color(&|index| kept.samples[index].specular));
    let toward = mean_toward(kept, &found);
    Some(Lent { diffuse, specular, toward, weights: [agreed, agreed * alike] })
}
