//! Damaged files of every kind load or are refused in a sentence, without a panic and without memory that they
//! do not have.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use foveate::scene::texture::Image;

use crate::common::builder::{glb, split_glb};
use crate::load_within;

/// Marsaglia's xorshift: the same damage in every run.
struct Damage(u64);

impl Damage {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n as u64) as usize
    }

    /// Changes bytes, cuts, or repeats a part.
    fn hurt(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..1 + self.below(6) {
            let at = self.below(bytes.len().max(1));
            match self.below(12) {
                _ if bytes.is_empty() => bytes.push(0),
                0 => bytes.truncate(at.max(1)),
                1 => bytes.extend_from_within(at..bytes.len().min(at + 64)),
                2 => bytes[at] = 0xFF,
                3 => bytes[at] = 0,
                4 => bytes[at] ^= 1 << self.below(8),
                _ => bytes[at] = self.below(256) as u8,
            }
        }
    }
}

fn seed(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files/scenes").join(name)
}

/// Bytes that a damaged scene may ask for.
const FREE: u64 = 600_000_000;

#[test]
fn compressed_geometry() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.glb");
    let mut damage = Damage(0x0123_4567_89AB_CDEF);
    let mut refused = 0;
    for name in ["draco.glb", "meshopt.glb"] {
        let (json, bin) = split_glb(&std::fs::read(seed(name)).unwrap());
        for _ in 0..150 {
            let mut bin = bin.clone();
            damage.hurt(&mut bin);
            std::fs::write(&path, glb(&json, &bin)).unwrap();
            if let Err(error) = load_within(&path, FREE) {
                let message = error.to_string();
                assert!(message.contains("damaged.glb") && !message.contains('\n'), "{message}");
                refused += 1;
            }
        }
    }
    assert!(refused > 100, "{refused} were noticed");
}

#[test]
fn objects_and_their_materials() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, library) = (folder.path().join("a.obj"), folder.path().join("a.mtl"));
    let text = "mtllib a.mtl\no box\nv 0 0 0\nv 1 0 0 1\nv 1 1 0 0.5 0.5 0.5\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n\
        usemtl a\ng one\nf 1/1/1 2/2/1 3/3/1 4/1/1\nusemtl b\nf -4//-1 -3//-1 -2//-1\nf 1 2 3\nl 1 2\np 1\ns off\n";
    let materials = "newmtl a\nKd 0.5 0.5 0.5\nKs 1 1 1\nNs 30\nillum 2\nd 0.5\nmap_Kd -s 2 2 -o 1 1 -bm 3 a.png\n\
        newmtl b\nKd 1\nTr 0.5\nKe 1 1 1\nmap_d a.png\nbump a.png\nPr 0.4\n";
    let mut damage = Damage(0xFEDC_BA98_7654_3210);
    let mut loaded = 0;
    for _ in 0..3000 {
        for (path, text) in [(&scene, text), (&library, materials)] {
            let mut bytes = text.as_bytes().to_vec();
            damage.hurt(&mut bytes);
            std::fs::write(path, bytes).unwrap();
        }
        loaded += usize::from(load_within(&scene, FREE).is_ok());
    }
    assert!(loaded > 100, "{loaded} were read");
}

#[test]
fn pictures() {
    use image::ImageFormat::{Bmp, Jpeg, Png, Tga, WebP};
    let picture =
        image::RgbImage::from_fn(24, 17, |x, y| image::Rgb([(x * 9) as u8, (y * 13) as u8, (x * y) as u8]));
    let mut damage = Damage(0x1357_9BDF_0246_8ACE);
    for format in [Png, Jpeg, WebP, Bmp, Tga] {
        let mut file = Cursor::new(Vec::new());
        picture.write_to(&mut file, format).unwrap();
        assert!(Image::decode(file.get_ref()).is_ok());
        for _ in 0..2000 {
            let mut bytes = file.get_ref().clone();
            damage.hurt(&mut bytes);
            // One that claims to be huge is left to the budget.
            if Image::size_of(&bytes).is_ok_and(|(width, height)| width * height < 1 << 22) {
                let _ = Image::decode(&bytes);
            }
        }
    }
}
