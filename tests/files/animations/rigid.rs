//! What moves as a whole and is kept as a shape: where instants put it.

use std::sync::Arc;

use foveate::bvh::{Parted, TreeFor, WideBvh};
use foveate::scene::animation::Choice;
use foveate::scene::instanced::Instance;
use foveate::scene::{Instanced, Instancing, LoadOptions, Scene};
use serde_json::json;

use super::{at, corners, difference, moved};
use crate::common::builder::Builder;
use crate::common::moving::{balls, world_of_two};

fn load(builder: &Builder, instancing: Instancing) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let options =
        LoadOptions { animation: Choice::All, keeps_motion: true, instancing, ..LoadOptions::default() };
    Scene::load_with(&builder.write_glb(folder.path()), &options).unwrap()
}

/// Where moving instances are at a time.
fn instances(scene: &Scene, time: f64) -> Vec<Option<Instance>> {
    let motion = scene.motion.as_ref().unwrap();
    motion.at(time, scene.anchor, &motion.own_triangles(&scene.mesh)).rigid
}

/// The scene with all that moves at a time.
fn moved_to(scene: &Scene, time: f64) -> Scene {
    let motion = scene.motion.as_ref().unwrap();
    let mut now = scene.clone();
    let own = motion.own_triangles(&scene.mesh);
    motion.at(time, scene.anchor, &own).apply(motion, &mut now.mesh, &mut now.lights);
    let kept = scene.instanced.as_deref().unwrap();
    let resting = motion.first_instance(kept);
    let moving = instances(scene, time).into_iter().map(|instance| instance.unwrap());
    let all = kept.instances[..resting].iter().copied().chain(moving);
    now.instanced = Some(Arc::new(Instanced { instances: all.collect(), ..kept.clone() }));
    now.flattened()
}

#[test]
fn instances_move_as_the_file_says() {
    let builder = world_of_two(true);
    let folder = tempfile::tempdir().unwrap();
    let path = builder.write_glb(folder.path());
    let scene = load(&builder, Instancing::Shared);
    let motion = scene.motion.as_ref().unwrap();
    // The boxes, one of which is mirrored; the lamp shines, and the tube bends.
    assert_eq!((motion.rigid.len(), motion.parts.len()), (2, 2));
    let kept = scene.instanced.as_ref().unwrap();
    assert_eq!((kept.shapes.len(), kept.instances.len()), (2, 2));
    for time in [0.0, 0.4, 1.3, 1.59] {
        let found = corners(&moved_to(&scene, time));
        let wanted = corners(&at(&path, "all", time).unwrap());
        assert!(difference(&found, &wanted) < 1e-5, "{time}: {}", difference(&found, &wanted));
    }
}

/// A small scene's parts are made anew, a large one's are not unless that is asked for.
#[test]
fn many_moving_triangles_are_kept_as_shapes() {
    let count = |builder: &Builder, instancing: Instancing| {
        let scene = load(builder, instancing);
        let motion = scene.motion.unwrap();
        (motion.parts.len(), motion.rigid.len(), scene.instanced.map_or(0, |kept| kept.mesh.triangles.len()))
    };
    let (few, many) = (balls(38), balls(39));
    let once = 1000 + 14;
    assert_eq!(count(&few, Instancing::Auto), (38, 0, 0));
    assert_eq!(count(&few, Instancing::Shared), (0, 38, once));
    assert_eq!(count(&many, Instancing::Auto), (0, 39, once));
    assert_eq!(count(&many, Instancing::Flat), (39, 0, 0));
}

/// One that is not finite at an instant stays where it was; one that is flat is nowhere, which the tree over it bears.
#[test]
fn what_has_no_place_is_in_no_tree() {
    let wide = moved(|b| {
        let (input, output) = (b.floats(&[[0.0], [1.0]]), b.floats(&[[1.0; 3], [3e38, 3e38, 3e38]]));
        b.json["animations"][0]["samplers"][0] = json!({ "input": input, "output": output });
        b.json["animations"][0]["channels"][0]["target"]["path"] = json!("scale");
        b.json["nodes"][0]["children"] = json!([1]);
        b.json["nodes"].as_array_mut().unwrap().push(json!({ "mesh": 0, "scale": [2, 2, 2] }));
    });
    let scene = load(&wide, Instancing::Shared);
    let there: Vec<bool> = instances(&scene, 1.0).iter().map(Option::is_some).collect();
    assert_eq!(there.iter().filter(|&&there| there).count(), 1, "{there:?}");

    let nothing = WideBvh::build(&[], &[]);
    let unit = (glam::Vec3::ZERO, glam::Vec3::ONE);
    let (whole, mut parted) =
        Parted::build(TreeFor::Packets, &[], &[], &[], nothing, &[(1, unit), (2, unit)]);
    let doors = |nodes: &[foveate::bvh::wide::WideNode]| {
        nodes.iter().filter_map(|node| node.instance()).collect::<Vec<_>>()
    };
    assert_eq!(doors(&whole.nodes), [1, 2]);
    parted.place([None, Some((2, unit))].into_iter());
    assert_eq!(doors(&parted.top().nodes), [2]);
    parted.place([None, None].into_iter());
    assert_eq!(doors(&parted.top().nodes), [0; 0]);
    assert_eq!(parted.top().nodes.len(), whole.nodes.len());
}
