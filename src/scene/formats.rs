//! Which reader a scene's file goes to, and what to do with files that none reads.

use std::path::Path;

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// glTF 2.0, as JSON or binary.
    Gltf,
    /// Wavefront OBJ.
    Obj,
}

/// How a format is told, and the way from it to one that is read.
struct Other {
    name: &'static str,
    extensions: &'static [&'static str],
    /// How its files begin, where they all do.
    magic: &'static [u8],
    way: &'static str,
}

const BLENDER: &str = "open it in Blender (File, Import) and export it as glTF 2.0 (.glb)";

const OTHERS: [Other; 17] = [
    other("Filmbox (FBX)", &["fbx"], b"Kaydara FBX Binary", BLENDER),
    other(
        "Blender",
        &["blend"],
        b"BLENDER",
        "open it in Blender and export it as glTF 2.0 (File, Export, .glb)",
    ),
    other("Universal Scene Description (USD)", &["usd", "usda"], b"#usda", BLENDER),
    other("Universal Scene Description (USD)", &["usdc"], b"PXR-USDC", BLENDER),
    other("Universal Scene Description (USD)", &["usdz"], b"", BLENDER),
    other("ZIP", &["zip"], b"PK\x03\x04", "unpack it and give the .gltf, .glb or .obj file inside"),
    other("gzip", &["gz", "tgz"], b"\x1F\x8B", "unpack it and give the .gltf, .glb or .obj file inside"),
    other("Stanford polygon (PLY)", &["ply"], b"ply\n", BLENDER),
    other("Stanford polygon (PLY)", &[], b"ply\r\n", BLENDER),
    other("stereolithography (STL)", &["stl"], b"", BLENDER),
    other("COLLADA", &["dae"], b"", BLENDER),
    other("3D Studio", &["3ds", "max"], b"", BLENDER),
    other("Alembic", &["abc"], b"Ogawa", BLENDER),
    other("X3D or VRML", &["x3d", "x3dv", "wrl"], b"#VRML", BLENDER),
    other("MagicaVoxel", &["vox"], b"VOX ", "export it from MagicaVoxel as .obj, and convert that to .glb"),
    other("pbrt", &["pbrt"], b"", "convert it with a pbrt importer for Blender, and export it as .glb"),
    other("MTL material", &["mtl"], b"", "give the .obj file that names it"),
];

const fn other(
    name: &'static str,
    extensions: &'static [&'static str],
    magic: &'static [u8],
    way: &'static str,
) -> Other {
    Other { name, extensions, magic, way }
}

/// The format of a file by its first bytes, and by its name where these do not tell; for one that is not
/// read, its name and the way to one that is.
pub fn format_of(path: &Path, start: &[u8]) -> Result<Format, String> {
    if start.starts_with(b"glTF") {
        return Ok(Format::Gltf);
    }
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    let begins = |other: &&Other| !other.magic.is_empty() && start.starts_with(other.magic);
    let called = |other: &&Other| other.extensions.contains(&extension.as_str());
    match OTHERS.iter().find(called).or_else(|| OTHERS.iter().find(begins)) {
        Some(Other { name, way, .. }) => {
            Err(format!("it is a {name} file, and .gltf, .glb and .obj files are read; {way}"))
        }
        None if extension == "obj" => Ok(Format::Obj),
        None => Ok(Format::Gltf),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_first_bytes_tell_formats() {
        let of = |name: &str, start: &[u8]| format_of(Path::new(name), start);
        for (name, start) in [("a.glb", &b"glTF\x02"[..]), ("a.vrm", b"glTF"), ("a.gltf", b"{"), ("a", b"{")]
        {
            assert_eq!(of(name, start), Ok(Format::Gltf), "{name}");
        }
        assert_eq!(of("a.OBJ", b"# Blender"), Ok(Format::Obj));
        for (name, start, part) in [
            ("a.fbx", &b""[..], "Filmbox"),
            ("A.FBX", b"; FBX 7", "Filmbox"),
            ("a.glb", b"Kaydara FBX Binary  ", "Filmbox"),
            ("a.usdz", b"PK\x03\x04", "USD"),
            ("a.zip", b"PK\x03\x04", "unpack"),
            ("town", b"BLENDER-v300", "export it as glTF"),
            ("a.ply", b"ply\nformat ascii", "PLY"),
            ("a.mtl", b"newmtl a", ".obj file that names it"),
        ] {
            let told = of(name, start).unwrap_err();
            assert!(told.contains(part), "{name}: {told}");
        }
    }
}
