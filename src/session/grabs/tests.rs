use glam::{DQuat, DVec3};

use super::*;
use crate::scene::animation::{Channel, Clip, Curve, Interpolation, Local, Property, Skeleton};
use crate::scene::grab::{Grabbable, HungBox};

const AT: DVec3 = DVec3::new(1.0, 1.0, 0.0);

/// Two cubes, 0.2 m wide: 0 at rest at [`AT`], turned; 1 rises from the origin, a metre a second, for ten.
fn motion() -> Arc<Motion> {
    let parts = |translation, rotation| Local::Parts { translation, rotation, scale: DVec3::ONE };
    let curve =
        Curve::new(vec![0.0, 10.0], vec![0.0, 0.0, 0.0, 0.0, 10.0, 0.0], 3, Interpolation::Linear).unwrap();
    let clip = Clip {
        name: String::new(),
        channels: vec![Channel { node: 1, property: Property::Translation, curve }],
    };
    let rest = vec![parts(AT, DQuat::from_rotation_x(0.3)), parts(DVec3::ZERO, DQuat::IDENTITY)];
    let bounds = (DVec3::splat(-0.1), DVec3::splat(0.1));
    let thing = |node| Grabbable { node, boxes: vec![HungBox { node, local: DMat4::IDENTITY, bounds }] };
    Arc::new(Motion {
        skeleton: Skeleton::new(vec![None; 2], vec![0, 1], rest, 1.0, vec![clip]),
        grabbable: vec![thing(0), thing(1)],
        ..Motion::default()
    })
}

fn grip(place: DVec3) -> Option<Pose> {
    Some(Pose::new(DQuat::IDENTITY, place))
}

fn grabs() -> Grabs {
    Grabs::new(&motion()).unwrap()
}

fn place(grabs: &Grabs, thing: usize) -> DVec3 {
    grabs.places[thing].unwrap().transform_point3(DVec3::ZERO)
}

#[test]
fn a_thing_keeps_its_place_in_the_hand_and_stays_where_it_is_put() {
    let mut grabs = grabs();
    let beside = AT + DVec3::X * 0.15;
    assert_eq!(grabs.step(&[None, grip(beside)], [false; 2], 0.0), [None, None]);
    grabs.step(&[None, grip(beside)], [false, true], 0.1);
    let rest = motion().pose(0.0, &[], &[]).world[0];
    assert!(grabs.places[0].unwrap().abs_diff_eq(rest, 1e-12), "it jumps as it is seized");
    // Half a turn about the vertical, and elsewhere: from the left of the hand to its right.
    let turned = Pose::new(DQuat::from_rotation_y(std::f64::consts::PI), DVec3::new(5.0, 2.0, 1.0));
    grabs.step(&[None, Some(turned)], [false, true], 0.2);
    assert!(place(&grabs, 0).distance(turned.position + DVec3::X * 0.15) < 1e-12);
    let carried = grabs.places[0].unwrap();
    let up = DVec3::new(0.0, 0.3f64.cos(), -(0.3f64.sin()));
    assert!(carried.transform_vector3(DVec3::Y).distance(up) < 1e-12, "turned with the hand");
    // Let go where the last step had it, whatever the hand does then.
    grabs.step(&[None, grip(DVec3::ZERO)], [false; 2], 0.3);
    grabs.step(&[None, grip(DVec3::ONE)], [false; 2], 0.4);
    assert_eq!(grabs.places, [Some(carried), None]);
}

#[test]
fn hands_seize_as_a_squeeze_begins_and_within_reach() {
    let mut grabs = grabs();
    let far = AT + DVec3::X * 0.21;
    grabs.step(&[grip(far), None], [true, false], 0.0);
    // Pressed already as it comes near.
    grabs.step(&[grip(AT), None], [true, false], 0.1);
    assert_eq!(grabs.places, [None, None]);
    grabs.step(&[grip(AT + DVec3::X * 0.19), None], [false; 2], 0.2);
    grabs.step(&[grip(AT + DVec3::X * 0.19), None], [true, false], 0.3);
    assert!(grabs.places[0].is_some() && grabs.places[1].is_none());
}

#[test]
fn the_other_hand_takes_a_thing_over_and_each_lets_its_own_go() {
    let mut grabs = grabs();
    grabs.step(&[grip(AT), None], [true, false], 0.0);
    let up = AT + DVec3::Y;
    grabs.step(&[grip(up), grip(up + DVec3::X * 0.05)], [true, true], 0.1);
    assert!(place(&grabs, 0).distance(up) < 1e-12, "taken from where it is now");
    // The first one goes away, and lets go; the second one has it.
    grabs.step(&[grip(DVec3::ZERO), grip(up + DVec3::X * 0.05)], [true, true], 0.2);
    assert!(place(&grabs, 0).distance(up) < 1e-12, "two hands pull");
    grabs.step(&[grip(DVec3::ZERO), grip(up + DVec3::X * 1.05)], [false, true], 0.3);
    assert!(place(&grabs, 0).distance(up + DVec3::X) < 1e-12, "the wrong hand let go");
    // And back: the right one, still squeezed, has nothing.
    let there = place(&grabs, 0);
    grabs.step(&[grip(there), grip(up + DVec3::X * 1.05)], [true, true], 0.35);
    grabs.step(&[grip(there + DVec3::Y), grip(up)], [true, true], 0.36);
    assert!(place(&grabs, 0).distance(there + DVec3::Y) < 1e-12, "two hands pull");
    grabs.step(&[grip(there + DVec3::Y), grip(up)], [false; 2], 0.37);
    grabs.step(&[grip(DVec3::ZERO), grip(there + DVec3::Y)], [false, true], 0.38);
    grabs.step(&[grip(DVec3::ZERO), grip(up + DVec3::X * 0.05)], [false, true], 0.39);
    // Both hands carry, each its own.
    let rising = DVec3::Y * 0.4;
    grabs.step(&[grip(rising), grip(up)], [true, true], 0.4);
    let held = (place(&grabs, 0), place(&grabs, 1));
    grabs.step(&[grip(rising + DVec3::Z), grip(up + DVec3::Z)], [true, true], 0.5);
    assert!(place(&grabs, 0).distance(held.0 + DVec3::Z) < 1e-12);
    assert!(place(&grabs, 1).distance(held.1 + DVec3::Z) < 1e-12);
}

#[test]
fn an_animated_thing_is_seized_where_it_is_and_leaves_its_animation() {
    let mut grabs = grabs();
    // Three metres up by then.
    grabs.step(&[None, grip(DVec3::Y * 3.0)], [false, true], 3.0);
    assert!(place(&grabs, 1).distance(DVec3::Y * 3.0) < 1e-9);
    let put = grabs.step(&[None; 2], [false; 2], 5.0).to_vec();
    let pose = motion().pose(5.0, &[], &put);
    assert!(pose.world[1].transform_point3(DVec3::ZERO).distance(DVec3::Y * 3.0) < 1e-9);
}

#[test]
fn what_a_lost_hand_holds_stays_until_the_hand_is_back() {
    for lost in [None, Some(Pose { rotation: DQuat::IDENTITY, position: DVec3::NAN })] {
        let mut grabs = grabs();
        grabs.step(&[None, grip(AT)], [false, true], 0.0);
        grabs.step(&[None, lost], [false, true], 0.1);
        assert!(place(&grabs, 0).distance(AT) < 1e-12);
        grabs.step(&[None, grip(AT + DVec3::X)], [false, true], 0.2);
        assert!(place(&grabs, 0).distance(AT + DVec3::X) < 1e-12);
        grabs.step(&[None, lost], [false, false], 0.3);
        grabs.step(&[None, grip(AT)], [false, false], 0.4);
        assert!(place(&grabs, 0).distance(AT + DVec3::X) < 1e-12);
        // Nothing is seized by a hand that is nowhere.
        grabs.step(&[None, lost], [false, true], 0.5);
        grabs.step(&[None, grip(AT)], [false, true], 0.6);
        assert!(place(&grabs, 0).distance(AT + DVec3::X) < 1e-12);
    }
}

#[test]
fn scenes_without_such_things_have_no_grabs() {
    assert!(Grabs::new(&Arc::new(Motion::default())).is_none());
}
