//! MTL materials as metallic-roughness ones.
//!
//! `Kd` becomes the base colour and `Ke` the emission. `Ns`, the exponent of Blinn and Phong, becomes
//! roughness by the GGX alpha of the same peak, sqrt(2 / (Ns + 2)) (Walter et al. 2007), where `Ks` and `illum`
//! say that there is a highlight at all. A material without diffuse colour and with a highlight that reflects
//! its surroundings (`illum` 3 and above) is a metal of colour `Ks`. `Pr` and `Pm`, which newer exporters write,
//! win over that. `d` and `Tr` are coverage. `map_d` cuts out, since leaves and fences are what it is used for.

use super::super::Outcome;
use super::super::gltf::json::{
    Document, Image, Int, MadeImage, Material, MetallicRoughness, Sampler, Texture, TextureInfo,
    TextureInfoExtensions, TextureTransform,
};
use super::super::source::{self, Folder};
use super::statements::{self, Map, Statements};

/// Colour of what has no material: a grey that reflects as much as plaster in shade.
const GREY: f64 = 0.6;

/// A material as the file says it.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Its name.
    pub name: String,
    /// Folder of its file, relative to the scene's, with a slash at its end; or empty.
    folder: String,
    statements: Statements,
}

/// Reads a file of materials that an OBJ names.
pub fn read(name: &str, folder: &Folder, limit: u64) -> Outcome<Vec<Source>> {
    let what = |problem: String| format!("its file of materials is not usable: {problem}");
    let found =
        folder.find_path(name).or_else(|problem| folder.find_path(base_name(name)).map_err(|_| problem));
    let path = found.map_err(what)?;
    let bytes = source::read_file(&path, limit).map_err(|error| what(error.to_string()))?;
    let text = super::text::tidy(bytes);
    let directory = name.replace('\\', "/");
    let directory = directory.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    let materials = statements::parse(&text).into_iter();
    Ok(materials.map(|(name, statements)| Source { name, folder: directory.clone(), statements }).collect())
}

/// What follows the last slash of either kind.
pub fn base_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Tells what of a material is not shown.
pub fn warn(source: &Source, warnings: &mut Vec<String>) {
    let unread =
        ["map_ks", "map_ns", "disp", "decal", "refl"].map(|key| (key, source.statements.contains_key(key)));
    let unread: Vec<&str> = unread.iter().filter(|(_, there)| *there).map(|(key, _)| *key).collect();
    if !unread.is_empty() {
        warnings.push(format!("material {:?} has {}, which is not read", source.name, unread.join(", ")));
    }
}

/// Adds a material to a document; returns its number.
pub fn add(document: &mut Document, source: &Source) -> usize {
    let number = |key: &str| source.get(key).and_then(|text| statements::numbers(text).first().copied());
    let color = |key: &str| source.get(key).and_then(statements::color);
    let (kd, ks) = (color("kd").unwrap_or([GREY; 3]), color("ks").unwrap_or([0.0; 3]));
    let illum = number("illum").unwrap_or(2.0);
    let picture = source.map("map_kd");
    let dark = |color: [f64; 3]| color.iter().all(|&c| c <= 0.01);

    let mirror = illum >= 3.0 && dark(kd) && !dark(ks) && picture.is_none();
    let shines = illum >= 2.0 && !dark(ks);
    let exponent = number("ns").filter(|_| shines).unwrap_or(0.0).max(0.0);
    let roughness = if shines { (2.0 / (exponent + 2.0)).powf(0.25) } else { 1.0 };
    // Some exporters blacken the colour of what has a picture.
    let base = if mirror {
        ks
    } else if picture.is_some() && dark(kd) {
        [1.0; 3]
    } else {
        kd
    };
    let coverage = number("d").or_else(|| number("tr").map(|tr| 1.0 - tr)).unwrap_or(1.0).clamp(0.0, 1.0);
    let mask = source.map("map_d").or_else(|| source.map("map_tr"));
    let emission = source.map("map_ke");
    let emissive = color("ke").filter(|&ke| !dark(ke)).or(emission.is_some().then_some([1.0; 3]));
    let bump = ["norm", "map_bump", "bump", "map_kn"].iter().find_map(|key| source.map(key));

    let file = |map: &Map| format!("{}{}", source.folder, map.file);
    let alpha = mask.as_ref().map(file);
    let base_color_texture = match (&picture, &mask) {
        (Some(map), _) => Some(texture(document, map, MadeImage { alpha, ..MadeImage::of(file(map)) })),
        (None, Some(map)) => {
            Some(texture(document, map, MadeImage { white: true, alpha, ..MadeImage::of(file(map)) }))
        }
        (None, None) => None,
    };
    let emissive_texture = emission.map(|map| texture(document, &map, MadeImage::of(file(&map))));
    let normal_texture = bump.map(|map| {
        texture(document, &map, MadeImage { height: Some(map.bump.to_bits()), ..MadeImage::of(file(&map)) })
    });
    let alpha_mode = match (mask, coverage < 1.0) {
        (Some(_), _) => Some("MASK".to_string()),
        (None, true) => Some("BLEND".to_string()),
        (None, false) => None,
    };
    document.materials.push(Material {
        name: Some(source.name.clone()),
        pbr_metallic_roughness: MetallicRoughness {
            base_color_factor: Some([base[0], base[1], base[2], coverage]),
            base_color_texture,
            metallic_factor: Some(number("pm").unwrap_or(f64::from(u8::from(mirror)))),
            roughness_factor: Some(number("pr").unwrap_or(roughness)),
            metallic_roughness_texture: None,
        },
        normal_texture,
        emissive_texture,
        emissive_factor: emissive,
        alpha_mode,
        // MTL does not say from which side a surface is seen, and OBJ's readers show both.
        double_sided: true,
        ..Default::default()
    });
    document.materials.len() - 1
}

impl Source {
    fn get(&self, key: &str) -> Option<&str> {
        self.statements.get(key).map(String::as_str)
    }

    fn map(&self, key: &str) -> Option<Map> {
        self.get(key).and_then(statements::map)
    }
}

fn texture(document: &mut Document, map: &Map, made: MadeImage) -> TextureInfo {
    let wrap = map.clamp.then_some(Int(33_071));
    document.samplers.push(Sampler { mag_filter: None, wrap_s: wrap, wrap_t: wrap });
    document.images.push(Image { name: None, uri: None, buffer_view: None, made: Some(made) });
    document.textures.push(Texture {
        sampler: Some(Int(document.samplers.len() - 1)),
        source: Some(Int(document.images.len() - 1)),
        extensions: Default::default(),
    });
    // In coordinates whose v runs down: v' = 1 - ((1 - v) * scale + offset).
    let transform = (map.scale != [1.0; 2] || map.offset != [0.0; 2]).then(|| TextureTransform {
        offset: Some([map.offset[0], 1.0 - map.scale[1] - map.offset[1]]),
        rotation: None,
        scale: Some(map.scale),
        tex_coord: None,
    });
    TextureInfo {
        index: Int(document.textures.len() - 1),
        tex_coord: Int(0),
        scale: None,
        strength: None,
        extensions: TextureInfoExtensions { transform },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(text: &str) -> (Document, Source) {
        let (name, statements) = statements::parse(text).remove(0);
        let source = Source { name, folder: "m/".into(), statements };
        let mut document = Document::default();
        add(&mut document, &source);
        (document, source)
    }

    #[test]
    fn colours_and_highlights_become_metallic_roughness() {
        let pbr = |text: &str| {
            let pbr = &material(text).0.materials[0].pbr_metallic_roughness;
            (pbr.base_color_factor.unwrap(), pbr.metallic_factor.unwrap(), pbr.roughness_factor.unwrap())
        };
        assert_eq!(pbr("newmtl a\nKd 0.1 0.2 0.3"), ([0.1, 0.2, 0.3, 1.0], 0.0, 1.0));
        assert_eq!(pbr("newmtl a\nKd 0.5\nTr 0.75\nillum 1\nKs 1 1 1\nNs 30").0[3], 0.25);
        assert_eq!(pbr("newmtl a\nKd 0.5\nd 0.75\nTr 0.75").0[3], 0.75);
        assert_eq!(pbr("newmtl a\nillum 1\nKs 1 1 1\nNs 30").2, 1.0);
        // alpha = sqrt(2 / 32) = 0.25, and roughness its root.
        assert!((pbr("newmtl a\nKs 0.5 0.5 0.5\nNs 30").2 - 0.5).abs() < 1e-12);
        assert_eq!(pbr("newmtl a\nKd 0 0 0\nKs 0.9 0.8 0.1\nillum 3\nNs 1e9").0, [0.9, 0.8, 0.1, 1.0]);
        assert_eq!(pbr("newmtl a\nKd 0 0 0\nKs 0.9 0.8 0.1\nillum 3").1, 1.0);
        assert_eq!(pbr("newmtl a\nKd 0 0 0\nmap_Kd a.png").0, [1.0; 4]);
        assert_eq!(pbr("newmtl a\nPr 0.3\nPm 1\nKs 1 1 1\nNs 7"), ([GREY, GREY, GREY, 1.0], 1.0, 0.3));
    }

    #[test]
    fn pictures_are_named_from_the_materials_folder() {
        let (document, _) = material(
            "newmtl a\nmap_Kd -s 2 4 c.png\nmap_d d.png\nmap_bump -bm 3 b.png\nKe 2 0 0\nmap_Ke e.png",
        );
        let made: Vec<&MadeImage> =
            document.images.iter().map(|image| image.made.as_ref().unwrap()).collect();
        assert_eq!((made[0].file.as_str(), made[0].alpha.as_deref()), ("m/c.png", Some("m/d.png")));
        assert_eq!((made[1].file.as_str(), made[2].height), ("m/e.png", Some(3.0_f64.to_bits())));
        let material = &document.materials[0];
        assert_eq!(
            (material.alpha_mode.as_deref(), material.emissive_factor),
            (Some("MASK"), Some([2.0, 0.0, 0.0]))
        );
        let texture = material.pbr_metallic_roughness.base_color_texture.as_ref().unwrap();
        let transform = texture.extensions.transform.as_ref().unwrap();
        assert_eq!((transform.scale, transform.offset), (Some([2.0, 4.0]), Some([0.0, -3.0])));
    }

    #[test]
    fn what_is_not_read_is_told() {
        let mut warnings = Vec::new();
        warn(&material("newmtl wood\nmap_Ks a.png\ndisp b.png").1, &mut warnings);
        assert_eq!(warnings, ["material \"wood\" has map_ks, disp, which is not read"]);
    }
}
