//! What clips change of materials: colours, and where textures lie.

use glam::{Mat2, Vec2, Vec3, Vec4};

use super::{Curve, Pose, Property};
use crate::scene::{Material, TextureRef};

/// Textures whose places change: of base colour, metalness and roughness, normals, occlusion and emission.
pub const PLACED_TEXTURES: usize = 5;

/// What of a material is known or has been changed, as the file has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Paint {
    /// Linear colour and alpha.
    pub base_color: Option<[f64; 4]>,
    /// Linear colour of what it emits.
    pub emissive: Option<[f64; 3]>,
    /// KHR_materials_emissive_strength.
    pub strength: Option<f64>,
    /// KHR_texture_transform of each texture.
    pub textures: [UvTransform; PLACED_TEXTURES],
}

/// KHR_texture_transform.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UvTransform {
    /// Of the texture coordinates.
    pub offset: Option<[f64; 2]>,
    /// Radians, counter-clockwise.
    pub rotation: Option<f64>,
    /// Along u and v.
    pub scale: Option<[f64; 2]>,
}

/// A material that changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingMaterial {
    /// Its index in the scene.
    pub material: usize,
    /// Its number in the file.
    pub number: usize,
    /// What the file says of it.
    pub rest: Paint,
    /// What else the loader has multiplied its base colour and its emission by: textures of one colour.
    pub made: Made,
}

/// Factors of base colour and emission beside those of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Made {
    /// Of the base colour.
    pub base_color: Vec4,
    /// Of the emission.
    pub emissive: Vec3,
}

impl Default for Made {
    fn default() -> Self {
        Made { base_color: Vec4::ONE, emissive: Vec3::ONE }
    }
}

impl MovingMaterial {
    /// Changes the scene's material to what it is in a pose.
    pub fn paint(&self, pose: &Pose, material: &mut Material) {
        if let Some(paint) = pose.materials.get(&self.number) {
            paint.apply(&self.rest, &self.made, material);
        }
    }
}

impl Paint {
    /// Takes a curve's value at a time, if it is of a material.
    pub fn take(&mut self, property: Property, curve: &Curve, time: f64) {
        self.set(property, |out| curve.sample(time, out));
    }

    /// Takes the greatest of all values of a curve, and the least alpha: what is ever seen of the material is seen then. Where
    /// textures lie stays.
    pub fn take_most(&mut self, property: Property, curve: &Curve) {
        if matches!(property, Property::BaseColor | Property::Emissive | Property::EmissiveStrength) {
            self.set(property, |out| {
                for (i, out) in out.iter_mut().enumerate() {
                    let (least, most) = curve.range(i);
                    *out = if i == 3 { least } else { most };
                }
            });
        }
    }

    fn set(&mut self, property: Property, read: impl Fn(&mut [f64])) {
        fn value<const N: usize>(read: impl Fn(&mut [f64])) -> Option<[f64; N]> {
            let mut numbers = [0.0; N];
            read(&mut numbers);
            Some(numbers)
        }
        match property {
            Property::BaseColor => self.base_color = value(read),
            Property::Emissive => self.emissive = value(read),
            Property::EmissiveStrength => self.strength = value::<1>(read).map(|[strength]| strength),
            Property::UvOffset(texture) => self.textures[texture].offset = value(read),
            Property::UvRotation(texture) => {
                self.textures[texture].rotation = value::<1>(read).map(|[angle]| angle);
            }
            Property::UvScale(texture) => self.textures[texture].scale = value(read),
            _ => {}
        }
    }

    /// Changes a material to this; `rest` is what the file says of it. Colours stay within what glTF allows.
    pub fn apply(&self, rest: &Paint, made: &Made, material: &mut Material) {
        if let (Some(color), Some(_)) = (self.base_color, rest.base_color) {
            material.base_color = Vec4::from(color.map(|c| c.clamp(0.0, 1.0) as f32)) * made.base_color;
        }
        if !material.unlit && (self.emissive.is_some() || self.strength.is_some()) {
            let strength = self.strength.or(rest.strength).unwrap_or(1.0);
            let color = self.emissive.or(rest.emissive).unwrap_or_default();
            let emitted = color.map(|c| (c * strength).clamp(0.0, f64::from(f32::MAX)) as f32);
            material.emissive = Vec3::from(emitted) * made.emissive;
        }
        for texture in 0..PLACED_TEXTURES {
            if let (Some((matrix, offset)), Some(use_of)) =
                (self.uv(rest, texture), placed(material, texture))
            {
                (use_of.matrix, use_of.offset) = (matrix, offset);
            }
        }
    }

    /// Where a texture lies, if that has changed.
    pub fn uv(&self, rest: &Paint, texture: usize) -> Option<(Mat2, Vec2)> {
        let (own, rest) = (self.textures[texture], rest.textures[texture]);
        (own != UvTransform::default()).then(|| {
            let UvTransform { offset, rotation, scale } = own;
            UvTransform {
                offset: offset.or(rest.offset),
                rotation: rotation.or(rest.rotation),
                scale: scale.or(rest.scale),
            }
            .matrix()
        })
    }
}

impl UvTransform {
    /// The matrix and the offset; numbers that single precision cannot hold become its largest.
    pub fn matrix(&self) -> (Mat2, Vec2) {
        let finite = |value: f64| value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
        let (sin, cos) = self.rotation.unwrap_or(0.0).sin_cos();
        let [x, y] = self.scale.unwrap_or([1.0; 2]);
        // Counter-clockwise as seen with v downwards: the extension's example and TextureTransformTest
        // agree on this, while an early draft's GLSL had the other sign.
        let matrix = [x * cos, -x * sin, y * sin, y * cos].map(finite);
        (Mat2::from_cols_array(&matrix), self.offset.unwrap_or([0.0; 2]).map(finite).into())
    }
}

fn placed(material: &mut Material, texture: usize) -> Option<&mut TextureRef> {
    let all = [
        &mut material.base_color_texture,
        &mut material.metallic_roughness_texture,
        &mut material.normal_texture,
        &mut material.occlusion_texture,
        &mut material.emissive_texture,
    ];
    all.into_iter().nth(texture)?.as_mut()
}
