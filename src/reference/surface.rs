//! What a material says at a hit.

use glam::{DVec2, DVec3, DVec4};

use super::intersect::{Hit, Ray, Tracer};
use super::layers::{SurfaceLayers, alpha_of, coat_share};
use super::texture::{self, TextureMode};
use crate::scene::{Layers, Scene, TextureRef};

/// Rays that leave a surface start this fraction of its largest coordinate above it: 4096 times finer
/// than the positions' own `f32` rounding, and far above that of `f64`.
const LIFT: f64 = 1.0 / (1u64 << 36) as f64;

/// Sine of the angle between a triangle's edge and the plane across the normal of one of its corners below which the edge
/// counts as lying in it.
const LEAST_BEND: f64 = 1e-3;
/// Cosine between a corner's normal and the triangle's from which on they describe a round surface.
const ROUND_COSINE: f64 = 0.72;

/// The least cosine between a shading normal and the direction towards the viewer.
const LEAST_FACING: f64 = 0.01;

/// A point of a surface, seen from one side, with its material evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Relative to the scene's anchor, in metres.
    pub position: DVec3,
    /// Unit normal of the triangle on the viewer's side.
    pub geometric_normal: DVec3,
    /// Unit normal of the side that light comes from: the triangle's, or the interpolated one where rays start above it.
    pub horizon: DVec3,
    /// Unit shading normal, normal map included.
    pub normal: DVec3,
    /// Unit direction towards the viewer.
    pub view: DVec3,
    /// Linear base colour.
    pub base_color: DVec3,
    /// Coverage, 0 to 1, whatever the material makes of it.
    pub alpha: f64,
    /// Metalness, 0 to 1.
    pub metallic: f64,
    /// Perceptual roughness, 0 to 1.
    pub roughness: f64,
    /// Emitted radiance.
    pub emission: DVec3,
    /// What the environment map's light is multiplied by, 0 to 1.
    pub occlusion: f64,
    /// The base colour is what is seen.
    pub unlit: bool,
    /// What extensions add.
    pub layers: Option<SurfaceLayers>,
    /// What glass is.
    pub glass: Option<SurfaceGlass>,
    lift: f64,
    /// How much higher rays start on the viewer's side.
    rise: f64,
}

/// A surface that light passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceGlass {
    /// How much passes instead of being reflected diffusely, 0 to 1.
    pub transmission: f64,
    /// The index of refraction.
    pub ior: f64,
    /// It has an inside, and refracts.
    pub solid: bool,
    /// It is seen from inside.
    pub back: bool,
    /// What the inside absorbs, a metre.
    pub attenuation: DVec3,
}

impl Surface {
    /// Evaluates the material where `ray` met it.
    pub fn at(tracer: &Tracer, ray: &Ray, hit: &Hit, mode: TextureMode) -> Self {
        let scene = tracer.scene();
        let material = tracer.material(hit.triangle);
        let corners = tracer.corners[hit.triangle as usize];
        let view = -ray.direction.normalize();
        let side = if hit.back { -1.0 } else { 1.0 };
        let geometric = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let read = |reference: &Option<TextureRef>| match reference {
            Some(reference) => lookup(scene, hit, reference, mode),
            None => DVec4::ONE,
        };
        let base = base_color(scene, hit, mode);
        let metallic_roughness = read(&material.metallic_roughness_texture);
        let occlusion = read(&material.occlusion_texture).x;
        let emissive = read(&material.emissive_texture).truncate();
        let glossy = material.layers.as_ref().is_some_and(|layers| layers.glossy);
        let (metallic, roughness) = if glossy {
            (0.0, 1.0 - (1.0 - f64::from(material.roughness)) * metallic_roughness.w)
        } else {
            let [roughness, metallic] = [metallic_roughness.y, metallic_roughness.z];
            (f64::from(material.metallic) * metallic, f64::from(material.roughness) * roughness)
        };
        let normals = vertex_normals(scene, hit).map(|n| n.map(|n| n * side));
        let rise = normals.and_then(|normals| rise_over(hit, corners, normals, geometric * side));
        let surface = Surface {
            position: interpolate(hit, corners),
            geometric_normal: geometric * side,
            horizon: match (rise, normals) {
                (Some(_), Some(normals)) => {
                    interpolate(hit, normals).try_normalize().unwrap_or(geometric * side)
                }
                _ => geometric * side,
            },
            rise: rise.unwrap_or_default(),
            normal: facing(
                mapped(scene, hit, geometric, mode, &material.normal_texture, material.normal_scale) * side,
                view,
                geometric * side,
            ),
            view,
            base_color: base.truncate(),
            alpha: base.w.clamp(0.0, 1.0),
            metallic: metallic.clamp(0.0, 1.0),
            roughness: roughness.clamp(0.0, 1.0),
            emission: material.emissive.as_dvec3() * emissive,
            occlusion: 1.0 + f64::from(material.occlusion_strength) * (occlusion - 1.0),
            unlit: material.unlit,
            layers: None,
            glass: None,
            lift: LIFT * corners.iter().fold(0.0, |most: f64, corner| most.max(corner.abs().max_element())),
        };
        let glass = material.glass.as_ref().filter(|_| !material.unlit).map(|glass| SurfaceGlass {
            transmission: f64::from(glass.transmission) * read(&glass.texture).x * (1.0 - surface.metallic),
            ior: f64::from(glass.ior),
            solid: glass.solid,
            back: hit.back,
            attenuation: glass.attenuation.as_dvec3(),
        });
        let surface = Surface { glass: glass.filter(|glass| glass.transmission > 0.0), ..surface };
        match &material.layers {
            Some(layers) => surface.with_layers(tracer, hit, layers, mode),
            None => surface,
        }
    }

    fn with_layers(self, tracer: &Tracer, hit: &Hit, layers: &Layers, mode: TextureMode) -> Self {
        let scene = tracer.scene();
        let [a, b, c] = tracer.corners[hit.triangle as usize];
        let geometric = (b - a).cross(c - a).normalize_or_zero();
        let side = if hit.back { -1.0 } else { 1.0 };
        let read = |reference: &Option<TextureRef>| {
            reference.as_ref().map_or(DVec4::ONE, |reference| lookup(scene, hit, reference, mode))
        };
        let color = layers.dielectric.as_dvec3() * read(&layers.specular_color_texture).truncate();
        let specular = f64::from(layers.specular) * read(&layers.specular_texture).w;
        let bent = mapped(scene, hit, geometric, mode, &layers.coat_normal_texture, layers.coat_normal_scale);
        let coat_normal = facing(bent * side, self.view, self.geometric_normal);
        let coat = f64::from(layers.coat) * read(&layers.coat_texture).x;
        let (tangent, alphas) = self.anisotropy(scene, hit, layers, mode);
        let added = SurfaceLayers {
            dielectric: color.min(DVec3::ONE) * specular,
            specular,
            tinted: layers.is_tinted(),
            tangent,
            alphas,
            coat,
            coat_alpha: alpha_of(f64::from(layers.coat_roughness) * read(&layers.coat_roughness_texture).y),
            coat_normal,
            sheen: layers.sheen_color.as_dvec3() * read(&layers.sheen_color_texture).truncate(),
            sheen_roughness: f64::from(layers.sheen_roughness) * read(&layers.sheen_roughness_texture).w,
        };
        let emission = self.emission * (1.0 - coat_share(coat, coat_normal, self.view));
        Surface { layers: Some(added), emission, ..self }
    }

    /// The tangent along which highlights are stretched, and the alphas along and across it.
    fn anisotropy(&self, scene: &Scene, hit: &Hit, layers: &Layers, mode: TextureMode) -> (DVec3, DVec2) {
        let alpha = alpha_of(self.roughness);
        let any = self.normal.any_orthonormal_vector();
        if layers.anisotropy == 0.0 || scene.mesh.tangents.is_empty() {
            return (any, DVec2::splat(alpha));
        }
        let given = vertices(scene, hit).map(|v| scene.mesh.tangents[v].as_dvec4());
        let mean: DVec4 = interpolate(hit, given);
        let u = mean.truncate().reject_from(self.normal).try_normalize().unwrap_or(any);
        let v = self.normal.cross(u) * given[0].w.signum();
        let (mut direction, mut strength) = (DVec2::X, f64::from(layers.anisotropy));
        if let Some(reference) = &layers.anisotropy_texture {
            let texel = lookup(scene, hit, reference, mode);
            direction = DVec2::new(texel.x, texel.y) * 2.0 - 1.0;
            strength *= texel.z;
        }
        let direction = DVec2::from_angle(f64::from(layers.anisotropy_rotation)).rotate(direction);
        let tangent = (u * direction.x + v * direction.y).try_normalize().unwrap_or(u);
        (tangent, DVec2::new(alpha + (1.0 - alpha) * strength * strength, alpha))
    }

    /// A ray that leaves the surface on the viewer's side.
    pub fn spawn(&self, direction: DVec3) -> Ray {
        Ray { origin: self.position + self.geometric_normal * (self.lift + self.rise), direction }
    }

    /// How far such a ray goes to what is so far away from the surface's own point.
    pub fn distance_left(&self, direction: DVec3, distance: f64) -> f64 {
        (distance - self.rise * self.geometric_normal.dot(direction)).max(0.0)
    }

    /// The same, not transmissive.
    pub fn without_glass(self) -> Self {
        Surface { glass: None, ..self }
    }

    /// A ray that leaves the surface on the other side.
    pub fn spawn_behind(&self, direction: DVec3) -> Ray {
        Ray { origin: self.position - self.geometric_normal * self.lift, direction }
    }

    /// Whether light from a unit direction can arrive: it is above the surface's horizon and the shading normal.
    pub fn faces(&self, direction: DVec3) -> bool {
        self.horizon.dot(direction) > 0.0 && self.normal.dot(direction) > 0.0
    }
}

/// The coverage at a hit, from level 0 of the base colour texture: 0 to 1.
pub(super) fn alpha(scene: &Scene, hit: &Hit) -> f64 {
    base_color(scene, hit, TextureMode::Level0).w.clamp(0.0, 1.0)
}

fn base_color(scene: &Scene, hit: &Hit, mode: TextureMode) -> DVec4 {
    let material = &scene.materials[scene.mesh.materials[hit.triangle as usize] as usize];
    let mut color = material.base_color.as_dvec4();
    if let Some(reference) = &material.base_color_texture {
        color *= lookup(scene, hit, reference, mode);
    }
    if !scene.mesh.colors.is_empty() {
        color *= interpolate(hit, vertices(scene, hit).map(|v| scene.mesh.colors[v].as_dvec4()));
    }
    color
}

fn lookup(scene: &Scene, hit: &Hit, reference: &TextureRef, mode: TextureMode) -> DVec4 {
    let uvs = &scene.mesh.uvs[reference.uv_slot as usize];
    let uv: DVec2 = if uvs.is_empty() {
        DVec2::ZERO
    } else {
        interpolate(hit, vertices(scene, hit).map(|v| uvs[v].as_dvec2()))
    };
    let uv = reference.matrix.as_dmat2() * uv + reference.offset.as_dvec2();
    texture::sample(&scene.textures[reference.texture as usize], uv, mode)
}

fn vertex_normals(scene: &Scene, hit: &Hit) -> Option<[DVec3; 3]> {
    let normals = &scene.mesh.normals;
    (!normals.is_empty()).then(|| vertices(scene, hit).map(|v| normals[v].as_dvec3()))
}

/// How high the surface that the normals of a triangle's corners describe rises over a hit, where it is round and lies above the
/// triangle somewhere, and no normal is far off its own: how far the hit is below the plane across each corner's normal, by the corner's weight (Hanika, "Hacking
/// the shadow terminator", 2021; here along the triangle's own normal alone). All normals are those on the hit's side.
fn rise_over(hit: &Hit, corners: [DVec3; 3], normals: [DVec3; 3], geometric: DVec3) -> Option<f64> {
    let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
    let (mut rise, mut is_round) = (0.0, false);
    for from in 0..3 {
        let mut height = 0.0;
        for to in (0..3).filter(|&to| to != from) {
            let edge = corners[to] - corners[from];
            let over = edge.dot(normals[from]);
            if over.abs() > LEAST_BEND * edge.length() {
                height += weights[to] * over;
                is_round |= over < 0.0;
            }
        }
        rise += normals[from].dot(geometric) * weights[from] * (-height).max(0.0);
    }
    let is_round = is_round && normals.iter().all(|normal| normal.dot(geometric) > ROUND_COSINE);
    is_round.then_some(rise.max(0.0))
}

/// The unit normal on the triangle's front: interpolated, then bent by a normal map, if there is one, in the frame
/// of the interpolated tangent t, the bitangent cross(n, t) * w and n.
fn mapped(
    scene: &Scene,
    hit: &Hit,
    geometric: DVec3,
    mode: TextureMode,
    map: &Option<TextureRef>,
    scale: f32,
) -> DVec3 {
    let mesh = &scene.mesh;
    let n = if mesh.normals.is_empty() {
        geometric
    } else {
        let smooth: DVec3 = interpolate(hit, vertices(scene, hit).map(|v| mesh.normals[v].as_dvec3()));
        smooth.try_normalize().unwrap_or(geometric)
    };
    let (Some(reference), false) = (map, mesh.tangents.is_empty()) else { return n };
    let tangent: DVec4 = interpolate(hit, vertices(scene, hit).map(|v| mesh.tangents[v].as_dvec4()));
    let Some(t) = tangent.truncate().try_normalize() else { return n };
    let bitangent = n.cross(t) * tangent.w.signum();
    let texel = lookup(scene, hit, reference, mode).truncate() * 2.0 - 1.0;
    let scale = f64::from(scale);
    let bent = t * (texel.x * scale) + bitangent * (texel.y * scale) + n * texel.z;
    bent.try_normalize().unwrap_or(n)
}

/// A normal that faces away from the viewer, bent until it just does not.
fn facing(normal: DVec3, view: DVec3, otherwise: DVec3) -> DVec3 {
    let lack = LEAST_FACING - normal.dot(view);
    if lack <= 0.0 { normal } else { (normal + view * lack).try_normalize().unwrap_or(otherwise) }
}

fn vertices(scene: &Scene, hit: &Hit) -> [usize; 3] {
    scene.mesh.triangles[hit.triangle as usize].map(|index| index as usize)
}

fn interpolate<T>(hit: &Hit, [a, b, c]: [T; 3]) -> T
where
    T: std::ops::Mul<f64, Output = T> + std::ops::Add<Output = T>,
{
    a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
}

#[cfg(test)]
mod tests {
    use glam::{Mat2, Vec2, Vec3, Vec4};

    use super::*;
    use crate::reference::testing::floor;
    use crate::scene::{Material, Texture, texture::Wrap};

    fn texture(texels: &[[u8; 4]], srgb: bool) -> Texture {
        let (width, wrap) = (texels.len() as u32, [Wrap::ClampToEdge; 2]);
        Texture { texels: texels.to_vec().into(), width, height: 1, srgb, wrap, nearest: false }
    }

    fn whole(texture: u32) -> Option<TextureRef> {
        Some(TextureRef { texture, uv_slot: 0, matrix: Mat2::IDENTITY, offset: Vec2::ZERO })
    }

    /// A floor of 2x2 m with u along +x, seen from straight above (or below) at (x, 0.2).
    fn seen(mut material: Material, textures: Vec<Texture>, x: f64, above: bool) -> Surface {
        material.double_sided = true;
        let mut scene = floor(1.0, material);
        scene.textures = textures;
        scene.mesh.normals = vec![Vec3::Y; 4];
        scene.mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 4];
        scene.mesh.uvs[0] = scene.mesh.positions.iter().map(|p| Vec2::new(p.x, p.z) * 0.5 + 0.5).collect();
        let tracer = Tracer::new(&scene);
        let height = if above { 1.0 } else { -1.0 };
        let ray = Ray { origin: DVec3::new(x, height, 0.2), direction: DVec3::Y * -height };
        let hit = tracer.closest(&ray, 9.0).unwrap();
        assert_eq!(hit.back, !above);
        Surface::at(&tracer, &ray, &hit, TextureMode::Level0)
    }

    #[test]
    fn textures_multiply_factors() {
        let material = Material {
            base_color: Vec4::new(0.5, 1.0, 1.0, 0.5),
            base_color_texture: whole(0),
            metallic: 0.5,
            roughness: 0.5,
            metallic_roughness_texture: whole(1),
            occlusion_texture: whole(1),
            occlusion_strength: 0.5,
            emissive: Vec3::splat(3.0),
            emissive_texture: whole(0),
            ..Material::default()
        };
        let textures = vec![texture(&[[255, 102, 0, 51]], true), texture(&[[51, 102, 204, 255]], false)];
        let surface = seen(material, textures, 0.5, true);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} is not {b}");
        close(surface.base_color.x, 0.5);
        close(surface.base_color.y, 0.132_868_3);
        close(surface.alpha, 0.1);
        close(surface.roughness, 0.2);
        close(surface.metallic, 0.4);
        close(surface.occlusion, 0.6);
        close(surface.emission.y, 3.0 * 0.132_868_3);
        close(surface.position.distance(DVec3::new(0.5, 0.0, 0.2)), 0.0);
    }

    #[test]
    fn uv_follow_the_triangle_and_the_transform() {
        let black_white = || vec![texture(&[[0, 0, 0, 255], [255, 255, 255, 255]], false)];
        let plain = Material { base_color_texture: whole(0), ..Material::default() };
        for x in [-0.4, 0.1, 0.3] {
            // Centres of the two texels lie at x = -0.5 and 0.5.
            let found = seen(plain.clone(), black_white(), x, true).base_color.x;
            assert!((found - (x + 0.5)).abs() < 1e-9, "{x}: {found}");
        }
        let turned = TextureRef { texture: 0, uv_slot: 0, matrix: -Mat2::IDENTITY, offset: Vec2::ONE };
        let material = Material { base_color_texture: Some(turned), ..Material::default() };
        let found = seen(material, black_white(), 0.3, true).base_color.x;
        assert!((found - 0.2).abs() < 1e-6, "{found}");
    }

    #[test]
    fn normal_map_bends_towards_the_tangent_and_back_hits_reverse_it() {
        let material = Material { normal_texture: whole(0), normal_scale: 0.5, ..Material::default() };
        // (1, 0.2, 0.6), its y a little off because bytes have no exact zero.
        let textures = || vec![texture(&[[255, 153, 204, 255]], false)];
        let front = seen(material.clone(), textures(), 0.3, true);
        // Bitangent: cross(+y, +x) * 1 = -z.
        let expected = DVec3::new(0.5, 0.6, -0.1).normalize();
        assert!(front.normal.distance(expected) < 1e-9, "{}", front.normal);
        assert_eq!(front.geometric_normal, DVec3::Y);
        let back = seen(material, textures(), 0.3, false);
        assert!(back.normal.distance(-expected) < 1e-9);
        assert_eq!(back.geometric_normal, DVec3::NEG_Y);
        assert!(back.spawn(DVec3::Y).origin.y < 0.0);
    }
}
