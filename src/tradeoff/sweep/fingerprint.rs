//! A name for a measurement.

use super::Subject;
use crate::tradeoff::store::Fingerprint;

/// A name for all that results depend on.
pub(super) fn fingerprint(subject: &Subject<'_>) -> String {
    let scene = &subject.loaded.scene;
    let environment = &subject.loaded.environment;
    let settings = format!(
        "{} {:?} {:?} {:?} {:?} {}",
        env!("CARGO_PKG_VERSION"),
        subject.config,
        subject.effort,
        subject.heads,
        subject.heads.iter().map(|pair| (subject.views)(pair[0])).collect::<Vec<_>>(),
        subject.device
    );
    let print = scene.meshes().fold(Fingerprint::default().add(settings.as_bytes()), |print, mesh| {
        let print =
            print.add(bytemuck::cast_slice(&mesh.positions)).add(bytemuck::cast_slice(&mesh.triangles));
        let print = print.add(bytemuck::cast_slice(&mesh.normals)).add(bytemuck::cast_slice(&mesh.tangents));
        let print = mesh.uvs.iter().fold(print, |print, uvs| print.add(bytemuck::cast_slice(uvs)));
        print.add(bytemuck::cast_slice(&mesh.colors)).add(bytemuck::cast_slice(&mesh.materials))
    });
    let print = scene.textures.iter().fold(print, |print, texture| {
        let how = (texture.width, texture.height, texture.srgb, texture.wrap, texture.nearest);
        print.add(texture.texels.as_flattened()).add(format!("{how:?}").as_bytes())
    });
    let instances = scene.instanced.as_ref().map(|instanced| &instanced.instances);
    print
        .add(format!("{instances:?}").as_bytes())
        .add(format!("{:?} {:?}", scene.materials, scene.lights).as_bytes())
        .add(format!("{:?} {:?} {}", scene.motion, subject.rest, subject.moves).as_bytes())
        .add(bytemuck::cast_slice(&environment.texels))
        .add(format!("{:?}", environment.sun).as_bytes())
        .name()
}
