//! glTF 2.0 files to a [`Scene`].
//!
//! A file passes through the rooms below in this order: its bytes are split and parsed (`container`,
//! `json`), all references are checked (`check`), buffers are read from the scene's folder (`source`,
//! `buffers`), nodes are composed as animations (`animations`) put them (`nodes`) and say what is shown
//! (`placements`, `placed`). Images are
//! then decoded (`images`) while geometry is read (`shape`, `reader`, `accessor`, `triangulate`, `skin`).
//! With both known, materials are reduced to what matters (`materials`, `extensions`), the attributes that are left
//! are read or made (`surface`, `tangents`), and all instances become one mesh (`flatten`, `vectors`).
//!
//! Nothing that a file claims is believed: indices, ranges and counts are checked before use.

mod accessor;
mod animations;
mod buffers;
mod check;
mod compressed;
mod container;
mod extensions;
mod flatten;
mod images;
mod instances;
pub(super) mod json;
mod made;
mod materials;
mod moving;
mod nodes;
mod placed;
mod placements;
mod reader;
mod shape;
mod shared;
mod skin;
mod surface;
mod tangents;
mod triangulate;
mod variants;
pub(super) mod vectors;
mod weigh;

use std::borrow::Cow;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;

use self::buffers::Buffers;
use self::images::{Decoded, Images};
use self::json::Document;
use self::materials::{Draft, Finished, TextureTable};
use self::nodes::Nodes;
use self::placed::PlacedLight;
use self::placements::{Placement, placements};
use self::shape::Shape;
use self::surface::Surface;
use super::animation::{Clip, ClipInfo, Motion, MovingLight, MovingMaterial, Paint, Part, Rigid, choose};
use super::grab::Grab;
use super::instanced::Instanced;
use super::options::by_name;
use super::source::{self, Folder};
use super::texture::mip_levels;
use super::{LeftOut, LoadOptions, Material, Outcome, Scene, Texture, emitters};
use crate::{Error, Result};

/// A `.glb` cannot be longer, and no sensible `.gltf` is.
const MAX_FILE: u64 = 1 << 32;

/// Materials by the document's index; `None` is the default material.
type ByMaterial<T> = BTreeMap<Option<usize>, T>;

/// Tells whether a scene's main file can be read, before anything is waited for.
///
/// # Errors
/// [`Error::File`] as [`load`].
pub fn check(path: &Path) -> Result<()> {
    source::open_file(path).map(drop).map_err(|error| Error::io(path, &error))
}

/// Reads a `.gltf` or `.glb` file and the buffers and images of its folder and below.
///
/// A file without any triangle gives an empty scene. What is left out or repaired is told in
/// [`Scene::warnings`].
///
/// # Errors
/// [`Error::File`] when the file itself cannot be read, [`Error::Scene`] when it or what it refers to is
/// malformed, missing, outside its folder, or requires an unsupported extension, when it takes more memory
/// than is free, and when it has no scene or variant of the name that the options give.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let bytes = source::read_file(path, MAX_FILE).map_err(|error| Error::io(path, &error))?;
    let folder = Folder::of(path).map_err(|error| Error::io(path, &error))?;
    let binary = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb"));
    let refuse = |problem| Error::Scene { path: path.to_path_buf(), problem };
    read(bytes.into(), binary, &folder, options).map_err(refuse)
}

/// Reads a binary glTF file from memory; `name` stands for it in messages. Nothing outside is read.
///
/// # Errors
/// [`Error::Scene`] as for [`load`].
pub fn load_glb(name: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Scene> {
    let refuse = |problem| Error::Scene { path: name.to_path_buf(), problem };
    read(bytes.into(), true, &Folder::none(), options).map_err(refuse)
}

fn read(bytes: Cow<'_, [u8]>, binary: bool, folder: &Folder, options: &LoadOptions) -> Outcome<Scene> {
    let mut warnings = Vec::new();
    let container = container::parse(&bytes, binary, &options.budget, &mut warnings)?;
    let mut document = container.document;
    check::references(&document)?;
    variants::choose(&mut document, options.variant.as_deref())?;
    from_document(&document, bytes, container.bin, folder, options, warnings)
}

/// The scene of a document whose references are in range. Buffer 0 is that part of `bytes` where it has no URI.
pub(super) fn from_document(
    document: &Document,
    bytes: Cow<'_, [u8]>,
    bin: Option<Range<usize>>,
    folder: &Folder,
    options: &LoadOptions,
    warnings: Vec<String>,
) -> Outcome<Scene> {
    let unplaced = unplaced(document, bin.map(|bin| &bytes[bin]), folder, options, warnings)?;
    // Before instances are placed, which takes as much again.
    drop(bytes);
    unplaced.scene(document, options)
}

/// All that is read of a file, before its instances are placed.
struct Unplaced {
    surfaces: Vec<Surface>,
    finished: ByMaterial<Finished>,
    textures: Vec<Texture>,
    nodes: Nodes,
    animations: Vec<ClipInfo>,
    dropped: LeftOut,
    warnings: Vec<String>,
}

fn unplaced(
    document: &Document,
    bin: Option<&[u8]>,
    folder: &Folder,
    options: &LoadOptions,
    mut warnings: Vec<String>,
) -> Outcome<Unplaced> {
    let budget = &options.budget;
    let mut buffers = Buffers::load(document, bin, folder, budget)?;
    buffers.take_views(compressed::views(document, &buffers, budget)?);
    let mut clips = animations::clips(document, &buffers, budget, &mut warnings)?;
    let (animations, playing) = playing(&mut clips, options)?;
    let grab = if options.keeps_motion { options.grab } else { Grab::None };
    let scene = chosen_scene(document, options)?;
    let nodes =
        Nodes::new(document, scene, options.scale, playing, (options.time, grab, options.keeps_motion))?;
    let placements = placements(document, &buffers, &nodes, options, &mut warnings)?;
    buffers.take_accessors(compressed::accessors(document, &buffers, &placements)?);
    let buffers = &buffers;

    // What changes later is read as it is at its brightest: all that is ever needed of it is there.
    let most = nodes.skeleton.most_paint();
    let paint = if options.keeps_motion { &most } else { &nodes.pose.materials };
    let mut drafts = drafts(document, &placements, paint, &mut warnings)?;
    let (images, shapes) = rayon::join(
        || Images { document, buffers, folder }.load(&images_of(&drafts), budget),
        || shapes(document, buffers, &nodes, placements, &drafts),
    );
    let ((images, unusable), mut shapes) = (images?, shapes?);
    warnings.extend(unusable);
    let dropped = retain_shown(&mut shapes);

    let least_alphas = least_alphas(&shapes);
    drafts.retain(|index, _| least_alphas.contains_key(index));
    drafts.iter_mut().for_each(|(index, draft)| draft.simplify(&images, least_alphas[index]));
    let mut table = TextureTable::default();
    let finished: ByMaterial<Finished> =
        drafts.into_iter().map(|(index, draft)| (index, draft.finish(&mut table, &mut warnings))).collect();

    let (textures, surfaces) = rayon::join(
        || textures(table, images),
        || {
            shapes
                .into_par_iter()
                .map(|shape| surface(document, buffers, shape, &finished))
                .collect::<Outcome<Vec<_>>>()
        },
    );
    Ok(Unplaced { surfaces: surfaces?, finished, textures, nodes, animations, dropped, warnings })
}

impl Unplaced {
    fn scene(self, document: &Document, options: &LoadOptions) -> Outcome<Scene> {
        let Unplaced { mut surfaces, finished, textures, nodes, animations, mut dropped, mut warnings } =
            self;
        let anchor = flatten::anchor(&surfaces, &nodes.pose);
        let numbers: HashMap<Option<usize>, u32> = finished.keys().copied().zip(0..).collect();
        let material_of: Vec<u32> = surfaces.iter().map(|surface| numbers[&surface.shape.material]).collect();
        let lacking = surfaces.iter().filter(|surface| surface.lacks_uvs).count();
        let painted = painted(document, &nodes, &finished, &numbers);
        let materials: Vec<Material> = finished.into_values().map(|finished| finished.material).collect();
        let (instanced, rigid, lost) = instanced(&mut surfaces, &material_of, &materials, anchor, options)?;
        dropped.add(lost, 1);
        let (mesh, parts, instances, collapsed) =
            flatten::flatten(&surfaces, &material_of, &nodes.pose, anchor);
        drop(surfaces);
        dropped.add(collapsed, 1);
        tell_left_out(dropped, lacking, &mut warnings);
        let placed = placed::lights(document, &nodes, anchor, &mut warnings)?;
        let motion = options
            .keeps_motion
            .then(|| motion(document, &nodes, (parts, rigid), &placed, painted, options.time))
            .flatten()
            .map(|mut motion| {
                motion.let_seize(&nodes.grabbable, instanced.as_ref());
                Arc::new(motion)
            });
        let cameras = placed::cameras(document, &nodes, &mut warnings);
        let mut said = HashSet::new();
        warnings.retain(|warning| said.insert(warning.clone()));
        Ok(Scene {
            anchor,
            mesh,
            instances: instances + instanced.as_ref().map_or(0, |instanced| instanced.instances.len()),
            instanced: instanced.map(Arc::new),
            materials,
            textures,
            lights: placed.into_iter().map(|placed| placed.light).collect(),
            cameras,
            camera: None,
            animations,
            motion,
            scenes: document.scenes.iter().map(|scene| scene.name.clone().unwrap_or_default()).collect(),
            variants: variants::names(document),
            left_out: dropped,
            warnings,
        })
    }
}

/// Takes what is kept once from the surfaces, and what of it was left out. What shines is not, since emitters are aimed at
/// one by one.
fn instanced(
    surfaces: &mut [Surface],
    material_of: &[u32],
    materials: &[Material],
    anchor: glam::DVec3,
    options: &LoadOptions,
) -> Outcome<(Option<Instanced>, Vec<Rigid>, LeftOut)> {
    let shines = |number: &u32| emitters::shines(&materials[*number as usize]);
    let shared = |(surface, number): (&Surface, &u32)| surface.shape.shared && !shines(number);
    let kept: Vec<bool> = surfaces.iter().zip(material_of).map(shared).collect();
    let flattened = surfaces.iter().zip(&kept).filter(|(surface, kept)| surface.shape.shared && !**kept);
    let triangles =
        flattened.map(|(s, _)| (s.shape.triangles.len() as u64) * s.shape.transforms.len() as u64);
    options.budget.plan_triangles(triangles.sum())?;
    Ok(shared::take(surfaces, material_of, &kept, anchor))
}

/// Keeps the shapes that have triangles; what is left out, of all instances.
fn retain_shown(shapes: &mut Vec<Shape>) -> LeftOut {
    let mut dropped = LeftOut::default();
    shapes.retain(|shape| {
        let nothing = shape.triangles.is_empty() && shape.dropped == LeftOut::default();
        let left_out = LeftOut { empty_primitives: usize::from(nothing), ..shape.dropped };
        dropped.add(left_out, shape.transforms.len());
        !shape.triangles.is_empty()
    });
    dropped
}

/// What moves, if anything does.
fn motion(
    document: &Document,
    nodes: &Nodes,
    (parts, rigid): (Vec<Part>, Vec<Rigid>),
    lights: &[PlacedLight],
    materials: Vec<MovingMaterial>,
    start: f64,
) -> Option<Motion> {
    let of_file = |number: usize| document.extensions.lights.as_ref().map(|list| &list.lights[number]);
    let moving = |(index, placed): (usize, &PlacedLight)| MovingLight {
        light: index,
        node: placed.node,
        number: placed.number,
        color: of_file(placed.number).and_then(|light| light.color),
        intensity: of_file(placed.number).and_then(|light| light.intensity),
    };
    let moves =
        |light: &MovingLight| nodes.moving[light.node] || nodes.pose.lights.contains_key(&light.number);
    let lights: Vec<MovingLight> = lights.iter().enumerate().map(moving).filter(moves).collect();
    let moves = !parts.is_empty() || !rigid.is_empty() || !lights.is_empty() || !materials.is_empty();
    let motion = || Motion {
        skeleton: nodes.skeleton.clone(),
        parts,
        rigid,
        lights,
        materials,
        given: Vec::new(),
        grabbable: Vec::new(),
        start,
    };
    moves.then(motion)
}

/// The scene's materials that change.
fn painted(
    document: &Document,
    nodes: &Nodes,
    finished: &ByMaterial<Finished>,
    numbers: &HashMap<Option<usize>, u32>,
) -> Vec<MovingMaterial> {
    let painted = nodes.pose.materials.keys().filter_map(|&number| {
        let (made, material) = (finished.get(&Some(number))?.made, *numbers.get(&Some(number))? as usize);
        Some(MovingMaterial { material, number, rest: materials::rest(&document.materials[number]), made })
    });
    painted.collect()
}

/// What is told of each clip, and those that play.
fn playing(clips: &mut [Clip], options: &LoadOptions) -> Outcome<(Vec<ClipInfo>, Vec<Clip>)> {
    let chosen = choose(clips, &options.animation)?;
    let tell = |(index, clip): (usize, &Clip)| ClipInfo {
        name: clip.name.clone(),
        seconds: clip.seconds(),
        channels: clip.channels.len(),
        plays: chosen.contains(&index),
    };
    let told = clips.iter().enumerate().map(tell).collect();
    Ok((told, chosen.iter().map(|&index| std::mem::take(&mut clips[index])).collect()))
}

/// Tells what was left out, and how many primitives lack coordinates.
fn tell_left_out(dropped: LeftOut, lacking: usize, warnings: &mut Vec<String>) {
    if lacking > 0 {
        warnings.push(format!("{lacking} primitives lack the texture coordinates that their materials read, which are taken as zero"));
    }
    if dropped.empty_primitives > 0 {
        warnings.push(format!("primitives without triangles were left out: {}", dropped.empty_primitives));
    }
    if dropped.no_area + dropped.not_finite > 0 {
        warnings.push(format!(
            "triangles were left out: {} without area, {} with coordinates that are not finite",
            dropped.no_area, dropped.not_finite
        ));
    }
}

/// The index of the scene to show: the one that is asked for, else the file's own choice, else the first.
fn chosen_scene(document: &Document, options: &LoadOptions) -> Outcome<usize> {
    let Some(wanted) = &options.scene else { return Ok(document.scene.map_or(0, |scene| scene.0)) };
    let names: Vec<&str> =
        document.scenes.iter().map(|scene| scene.name.as_deref().unwrap_or_default()).collect();
    by_name(&names, wanted, "scene")
}

fn drafts(
    document: &Document,
    placements: &[Placement],
    paint: &BTreeMap<usize, Paint>,
    warnings: &mut Vec<String>,
) -> Outcome<ByMaterial<Draft>> {
    let mut drafts = ByMaterial::new();
    for placement in placements {
        let index =
            document.meshes[placement.mesh].primitives[placement.primitive].material.map(|index| index.0);
        if let Entry::Vacant(entry) = drafts.entry(index) {
            let paint = index.and_then(|index| paint.get(&index)).copied().unwrap_or_default();
            entry.insert(Draft::new(document, index, &paint, warnings)?);
        }
    }
    Ok(drafts)
}

fn images_of(drafts: &ByMaterial<Draft>) -> Vec<usize> {
    let mut images: Vec<usize> = drafts.values().flat_map(Draft::images).collect();
    images.sort_unstable();
    images.dedup();
    images
}

fn shapes(
    document: &Document,
    buffers: &Buffers<'_>,
    nodes: &Nodes,
    placements: Vec<Placement>,
    drafts: &ByMaterial<Draft>,
) -> Outcome<Vec<Shape>> {
    let read = |placement: Placement| {
        let material = document.meshes[placement.mesh].primitives[placement.primitive].material;
        let tangents = drafts[&material.map(|index| index.0)].needs_tangents();
        Shape::read(document, buffers, nodes, placement, tangents)
    };
    placements.into_par_iter().map(read).collect()
}

fn least_alphas(shapes: &[Shape]) -> ByMaterial<f32> {
    let mut least = ByMaterial::new();
    for shape in shapes {
        let alpha = least.entry(shape.material).or_insert(1.0_f32);
        *alpha = alpha.min(shape.least_alpha());
    }
    least
}

fn surface(
    document: &Document,
    buffers: &Buffers<'_>,
    shape: Shape,
    finished: &ByMaterial<Finished>,
) -> Outcome<Surface> {
    let material = &finished[&shape.material];
    Surface::new(document, buffers, shape, material)
}

/// Textures that read one image share its texels, unless one of them takes it for sRGB and another does not.
fn textures(table: TextureTable, mut images: HashMap<usize, Arc<Decoded>>) -> Vec<Texture> {
    let mut numbers = HashMap::new();
    let mut distinct = Vec::new();
    let mut uses = Vec::new();
    for (index, sampling) in table.list {
        let Some(image) = images.get(&index) else { continue };
        let number = *numbers.entry((Arc::as_ptr(image), sampling.srgb)).or_insert_with(|| {
            distinct.push((image.clone(), sampling.srgb));
            distinct.len() - 1
        });
        uses.push((number, sampling));
    }
    images.clear();
    let levels = |(image, srgb): (Arc<Decoded>, bool)| {
        let size = [image.image.width, image.image.height];
        // The last to use an image takes its texels instead of copying them.
        let image = Arc::try_unwrap(image).map_or_else(|shared| shared.image.clone(), |own| own.image);
        (Arc::new(mip_levels(image, srgb)), size)
    };
    let made: Vec<_> = distinct.into_par_iter().map(levels).collect();
    uses.into_iter()
        .map(|(number, sampling)| Texture::new(made[number].0.clone(), made[number].1, sampling))
        .collect()
}

/// A number of the file as a finite `f32`.
fn finite(value: f64) -> f32 {
    value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
}
