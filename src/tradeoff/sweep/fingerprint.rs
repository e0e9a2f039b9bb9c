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
        print.add(bytemuck::cast_slice(&mesh.positions)).add(bytemuck::cast_slice(&mesh.triangles))
    });
    let instances = scene.instanced.as_ref().map(|instanced| &instanced.instances);
    print
        .add(format!("{instances:?}").as_bytes())
        .add(format!("{:?}", scene.materials).as_bytes())
        .add(bytemuck::cast_slice(&environment.texels))
        .add(format!("{:?}", environment.sun).as_bytes())
        .name()
}
