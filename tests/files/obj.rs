//! Wavefront OBJ: what it says is what is seen.

use std::path::{Path, PathBuf};

use foveate::scene::generate::{obj, voxel_town};
use foveate::scene::{AlphaMode, LoadOptions, Scene};
use glam::{DVec3, Vec4};

use crate::{common, write_png};

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

const QUAD: &str = "v 0 0 0\nv 2 0 0\nv 2 0 -1\nv 0 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

/// Sum of the triangles' areas, and their mean normal.
fn area(scene: &Scene) -> (f64, DVec3) {
    let mesh = &scene.mesh;
    let crosses = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
        (b - a).cross(c - a) * 0.5
    });
    crosses.fold((0.0, DVec3::ZERO), |(area, sum), cross| (area + cross.length(), sum + cross))
}

#[test]
fn quads_materials_and_pictures_are_read_with_v_upwards() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("m")).unwrap();
    // Red below, blue above.
    let picture =
        image::RgbImage::from_fn(2, 2, |_, y| image::Rgb(if y == 0 { [0, 0, 255] } else { [255, 0, 0] }));
    picture.save(folder.path().join("m/wall.png")).unwrap();
    write(
        folder.path(),
        "m/a.mtl",
        "newmtl wall\nKd 0.5 0.5 0.5\nmap_Kd WALL.png\nnewmtl glass\nd 0.25\nKd 1 0 0\nKe 0 2 0",
    );
    let text =
        format!("mtllib m/a.mtl\n{QUAD}usemtl wall\nf 1/1 2/2 3/3 4/4\nusemtl glass\nf -4/-4 -3/-3 -2/-2\n");
    let scene = Scene::load(&write(folder.path(), "a.obj", &text)).unwrap();
    assert_eq!((scene.mesh.triangles.len(), scene.warnings.len()), (3, 0), "{:?}", scene.warnings);
    let of = |name: &str| scene.materials.iter().position(|m| m.name == name).unwrap();
    let wall = &scene.materials[of("wall")];
    assert_eq!((wall.metallic, wall.roughness, wall.alpha), (0.0, 1.0, AlphaMode::Opaque));
    let texture = &scene.textures[wall.base_color_texture.unwrap().texture as usize];
    assert_eq!(texture.texels[0], [0, 0, 255, 255]);
    // Where the OBJ's v is 0, the picture's lower edge is.
    let near =
        scene.mesh.positions.iter().position(|p| (scene.anchor + p.as_dvec3()).length() < 1e-6).unwrap();
    assert_eq!(scene.mesh.uvs[0][near].y, 1.0);
    let glass = &scene.materials[of("glass")];
    assert_eq!(
        (glass.base_color, glass.alpha, glass.emissive.y),
        (Vec4::new(1.0, 0.0, 0.0, 0.25), AlphaMode::Blend, 2.0)
    );
}

#[test]
fn dented_polygons_keep_their_shape() {
    let folder = tempfile::tempdir().unwrap();
    let l = "v 0 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 1 3 0\nv 0 3 0\nf 1 2 3 4 5 6\n";
    let scene = Scene::load(&write(folder.path(), "l.obj", l)).unwrap();
    let (area, normal) = area(&scene);
    assert_eq!(scene.mesh.triangles.len(), 4);
    assert!((area - 5.0).abs() < 1e-6 && (normal - DVec3::Z * 5.0).length() < 1e-6, "{area} {normal}");
}

#[test]
fn scale_makes_metres_of_units() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "a.obj", &format!("{QUAD}f 1 2 3 4\n"));
    let options = LoadOptions { scale: 0.01, ..LoadOptions::default() };
    let (area, _) = area(&Scene::load_with(&path, &options).unwrap());
    assert!((area - 2e-4).abs() < 1e-9, "{area}");
}

#[test]
fn missing_materials_and_pictures_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "a.obj", &format!("mtllib none.mtl\n{QUAD}usemtl a\nf 1/1 2/2 3/3\n"));
    let scene = Scene::load(&path).unwrap();
    assert!(
        scene.warnings[0].contains("none.mtl") && scene.warnings[0].contains("grey"),
        "{:?}",
        scene.warnings
    );
    assert_eq!((scene.mesh.triangles.len(), scene.materials[0].metallic), (1, 0.0));
    write(folder.path(), "none.mtl", "newmtl a\nKd 1\nmap_Kd C:\\pictures\\none.png\n");
    let scene = Scene::load(&path).unwrap();
    assert!(scene.warnings[0].contains("none.png"), "{:?}", scene.warnings);
    // One that was made elsewhere is found beside the scene.
    write_png(&folder.path().join("none.png"), 2, 2);
    let scene = Scene::load(&path).unwrap();
    assert_eq!((scene.warnings.len(), scene.textures.len()), (0, 1), "{:?}", scene.warnings);
}

#[test]
fn masks_cut_out_and_heights_become_normals() {
    let folder = tempfile::tempdir().unwrap();
    write_png(&folder.path().join("c.png"), 4, 4);
    let grey = |f: fn(u32) -> u8| image::GrayImage::from_fn(4, 4, move |x, _| image::Luma([f(x)]));
    grey(|x| if x < 2 { 0 } else { 255 }).save(folder.path().join("mask.png")).unwrap();
    grey(|x| (x * 40) as u8).save(folder.path().join("bump.png")).unwrap();
    write(folder.path(), "a.mtl", "newmtl a\nmap_Kd c.png\nmap_d mask.png\nmap_bump -bm 2 bump.png\n");
    let text = format!("mtllib a.mtl\n{QUAD}usemtl a\nf 1/1 2/2 3/3 4/4\n");
    let scene = Scene::load(&write(folder.path(), "a.obj", &text)).unwrap();
    let material = &scene.materials[0];
    assert_eq!(material.alpha, AlphaMode::Mask(0.5));
    let texels = |texture: Option<foveate::scene::TextureRef>| {
        &scene.textures[texture.unwrap().texture as usize].texels
    };
    let alphas: Vec<u8> = texels(material.base_color_texture)[..4].iter().map(|texel| texel[3]).collect();
    assert_eq!(alphas, [0, 0, 255, 255]);
    assert!(texels(material.normal_texture)[1][0] < 120, "what rises to the right leans to the left");
}

#[test]
fn what_cannot_be_read_is_told_by_its_line() {
    let folder = tempfile::tempdir().unwrap();
    for (text, part) in [
        ("v 0 0 0\nv 1 x 0\n", "line 2"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cannot be read"),
        ("v 0 0 0\nf 1 2 a\n", "line 2"),
    ] {
        let path = write(folder.path(), "a.obj", text);
        let message = Scene::load(&path).unwrap_err().to_string();
        assert!(message.contains("a.obj") && message.contains(part), "{message}");
    }
    for text in ["", "v 0 0 0", "f 1 1 1", "\u{0}\u{1}", "newmtl", "mtllib", "o\ng\n"] {
        let path = write(folder.path(), "a.obj", text);
        assert!(Scene::load(&path).map_or(true, |scene| scene.mesh.triangles.is_empty()), "{text:?}");
    }
}

#[test]
fn a_town_as_obj_is_the_same_town() {
    let folder = tempfile::tempdir().unwrap();
    let glb = voxel_town::generate(10_000, 1).unwrap();
    let town = Scene::from_glb(Path::new("town.glb"), &glb).unwrap();
    let path = folder.path().join("town.obj");
    let size = obj::write(&path, &town).unwrap();
    assert_eq!(size as u64, std::fs::metadata(&path).unwrap().len());
    let read = Scene::load(&path).unwrap();
    assert_eq!(read.warnings, Vec::<String>::new());
    assert_eq!(read.mesh.triangles.len(), town.mesh.triangles.len());
    assert_eq!(read.materials.len(), town.materials.len());
    // A picture that cuts out and shines is two here.
    assert!((town.textures.len()..town.textures.len() + 3).contains(&read.textures.len()));
    let ((a, normals_a), (b, normals_b)) = (area(&read), area(&town));
    assert!((a / b - 1.0).abs() < 1e-5 && (normals_a - normals_b).length() < 1e-5 * b, "{a} {b}");
    let bounds = |scene: &Scene| {
        scene
            .mesh
            .bounds()
            .map(|(low, high)| (scene.anchor + low.as_dvec3(), scene.anchor + high.as_dvec3()))
            .unwrap()
    };
    let ((low_a, high_a), (low_b, high_b)) = (bounds(&read), bounds(&town));
    assert!((low_a - low_b).length() < 1e-3 && (high_a - high_b).length() < 1e-3);
}

#[test]
fn sibenik_opens_without_its_materials() {
    let Some(archive) = common::data("scenes/sibenik/sibenik.zip") else { return };
    let folder = tempfile::tempdir().unwrap();
    // Python is there wherever the tests' packages are.
    let unpacked = std::process::Command::new("python3")
        .args(["-m", "zipfile", "-e"])
        .args([&archive, folder.path()])
        .status();
    if !unpacked.is_ok_and(|status| status.success()) {
        eprintln!("not run: python3 cannot unpack {}", archive.display());
        return;
    }
    let scene = Scene::load(&folder.path().join("sibenik.obj")).unwrap();
    let left = scene.left_out.no_area;
    assert_eq!(scene.mesh.triangles.len() + left, 73_564);
    assert!(scene.warnings[0].contains("untitled.mtl"), "{:?}", scene.warnings);
}
