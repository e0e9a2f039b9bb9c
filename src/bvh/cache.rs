//! Trees on disk, found by what they were built from, so that a large scene starts quickly the second time.
//!
//! A file holds, little-endian: the eight bytes `FVTREE01`; the XXH3 hash of all that follows (16 bytes);
//! the numbers of nodes and of triangles in leaf order (8 bytes each); the nodes; the triangles in leaf
//! order (4 bytes each). Where a file is missing, cut short or changed, the tree is built anew. Together
//! files take at most [`MOST_BYTES`]: those that were not used for longest go first. A checksum says nothing about
//! who wrote it: a tree is used only if it is sound ([`WideBvh::is_sound`]).
//!
//! **Trees on disk.** Trees of 50,000 triangles and more are kept in `$XDG_CACHE_HOME/foveate/trees` under a
//! hash of their triangles and of what walks the tree (XXH3, by the xxhash-rust crate), at most 1 GiB together. A checksum does not tell
//! who wrote a file, and kernels look neither at where links lead nor at how deep they go: a tree is used
//! only if one pass over it finds every node below one parent, no hole before a child, every place in one
//! leaf, boxes that hold what is below them, and no path longer than the stacks (`src/bvh/check.rs`).
//! Anything else is built anew. `tests/kernels/trees.rs` sends damaged trees that pass through the kernels
//! and wants the hits of the whole one. The cache's folders are the user's alone (mode 0700, refused where
//! others may write), and what stands in a file's place, a link, a pipe, another user's file, is never opened
//! or followed (`src/private_file.rs`). What a killed process has left half written is swept by the next one.

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use glam::Vec3;
use xxhash_rust::xxh3::Xxh3;

use super::TreeFor;
use super::wide::{EMPTY, LEAF, LeafSlot, WideBvh, WideNode, leaf_range};
use crate::error::Error;
use crate::private_file::{self, user_folder};
use crate::whole_file;

/// Changes whenever other trees are built from the same triangles, or files look different.
const BUILDER: &[u8] = b"foveate tree 1";
const MAGIC: &[u8; 8] = b"FVTREE01";
const HEADER: usize = 8 + 16 + 8 + 8;
/// Bytes of all files together at most.
pub const MOST_BYTES: u64 = 1 << 30;
/// Scenes with fewer triangles are built faster than anyone notices.
pub const LEAST_TRIANGLES: usize = 50_000;

/// A folder of trees.
#[derive(Clone, Debug)]
pub struct TreeCache {
    folder: PathBuf,
    most_bytes: u64,
}

impl TreeCache {
    /// The user's cache: `$XDG_CACHE_HOME/foveate/trees`, or `~/.cache/foveate/trees`; `None` without a home.
    pub fn of_user() -> Option<TreeCache> {
        Some(TreeCache::in_folder(user_folder()?.join("trees")))
    }

    /// A cache in a folder, which is made when it is needed.
    pub fn in_folder(folder: PathBuf) -> TreeCache {
        TreeCache { folder, most_bytes: MOST_BYTES }
    }

    /// The tree over these triangles for what is to walk it, and whether it was found: else it is built by `build` and kept. A
    /// cache that cannot be written is no error, only slow.
    pub fn find_or(
        &self,
        tree_for: TreeFor,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        build: impl FnOnce() -> WideBvh,
    ) -> (WideBvh, bool) {
        if triangles.len() < LEAST_TRIANGLES {
            return (build(), false);
        }
        let path = self.folder.join(format!("{:032x}.tree", key(tree_for, positions, triangles)));
        if let Some(tree) = read(&path, positions, triangles) {
            return (tree, true);
        }
        let tree = build();
        if self.keep(&path, &tree).is_ok() {
            self.make_room();
        }
        (tree, false)
    }

    fn keep(&self, path: &Path, tree: &WideBvh) -> Result<(), Error> {
        let order: Vec<u32> = tree.order.iter().map(|slot| slot.triangle).collect();
        let counts = [tree.nodes.len() as u64, order.len() as u64];
        let parts: [&[u8]; 3] =
            [bytemuck::cast_slice(&counts), bytemuck::cast_slice(&tree.nodes), bytemuck::cast_slice(&order)];
        let mut hash = Xxh3::new();
        parts.iter().for_each(|part| hash.update(part));
        private_file::write(path, |file| {
            let head = [&MAGIC[..], &hash.digest128().to_le_bytes()];
            head.iter()
                .chain(&parts)
                .try_for_each(|part| file.write_all(part))
                .map_err(|e| Error::writing(path, &e))
        })
    }

    /// Removes the files that were not used for longest until the rest fits, and what killed processes have left.
    fn make_room(&self) {
        whole_file::sweep(&self.folder);
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        let mut files: Vec<(SystemTime, u64, PathBuf)> = entries
            .flatten()
            .filter(|entry| entry.path().extension().is_some_and(|e| e == "tree" || e == "part"))
            .filter_map(|entry| {
                let about = entry.metadata().ok()?;
                Some((about.modified().ok()?, about.len(), entry.path()))
            })
            .collect();
        files.sort_unstable();
        let mut bytes: u64 = files.iter().map(|file| file.1).sum();
        for (_, size, path) in
            files.into_iter().filter(|file| file.2.extension().is_some_and(|e| e == "tree"))
        {
            if bytes <= self.most_bytes {
                break;
            }
            if fs::remove_file(path).is_ok() {
                bytes -= size;
            }
        }
    }
}

/// What a tree is found by: everything that it depends on.
fn key(tree_for: TreeFor, positions: &[Vec3], triangles: &[[u32; 3]]) -> u128 {
    let mut hash = Xxh3::new();
    hash.update(BUILDER);
    if tree_for == TreeFor::SingleRays {
        hash.update(b" for single rays");
    }
    hash.update(&(positions.len() as u64).to_le_bytes());
    hash.update(bytemuck::cast_slice(positions));
    hash.update(bytemuck::cast_slice(triangles));
    hash.digest128()
}

/// The most pieces that a builder makes of a triangle on average, with plenty to spare.
const MOST_PIECES: usize = 4;

/// A tree from a file; `None` where it is not there, not whole or not sound. The time of the last use, which decides
/// which file goes first, becomes now.
fn read(path: &Path, positions: &[Vec3], triangles: &[[u32; 3]]) -> Option<WideBvh> {
    let mut file = private_file::open(path)?;
    let mut head = [0; HEADER];
    file.read_exact(&mut head).ok()?;
    let number = |at: usize| u64::from_le_bytes(head[at..at + 8].try_into().expect("eight bytes")) as usize;
    let (nodes, places) = (number(24), number(32));
    let size = nodes.checked_mul(size_of::<WideNode>())?.checked_add(places.checked_mul(4)?)?;
    let length = file.metadata().ok()?.len();
    // Before memory is taken: each place and each node has a triangle below it.
    let few = places <= triangles.len().checked_mul(MOST_PIECES)? && nodes <= places.max(1);
    if &head[..8] != MAGIC || length != (HEADER as u64).checked_add(size as u64)? || !few {
        return None;
    }
    let mut tree = WideBvh { nodes: vec![WideNode::VACANT; nodes], order: Vec::new() };
    let mut order = vec![0u32; places];
    file.read_exact(bytemuck::cast_slice_mut(&mut tree.nodes)).ok()?;
    file.read_exact(bytemuck::cast_slice_mut(&mut order)).ok()?;
    let mut hash = Xxh3::new();
    hash.update(&head[24..]);
    hash.update(bytemuck::cast_slice(&tree.nodes));
    hash.update(bytemuck::cast_slice(&order));
    if hash.digest128().to_le_bytes() != head[8..24] {
        return None;
    }
    tree.order = slots(&tree.nodes, &order, triangles.len())?;
    if !tree.is_sound(positions, triangles) {
        return None;
    }
    let _ = file.set_modified(SystemTime::now());
    Some(tree)
}

/// Lanes and lengths of leaves, from the nodes; `None` where a link leads nowhere.
fn slots(nodes: &[WideNode], order: &[u32], triangles: usize) -> Option<Vec<LeafSlot>> {
    let vacant = LeafSlot { triangle: u32::MAX, lane: 0, leaf_len: 0 };
    let mut slots = vec![vacant; order.len()];
    for (index, node) in nodes.iter().enumerate() {
        for child in node.children.into_iter().filter(|&child| child != EMPTY) {
            if child & LEAF == 0 {
                if child as usize <= index || child as usize >= nodes.len() {
                    return None;
                }
                continue;
            }
            let (first, count) = leaf_range(child);
            for (lane, slot) in slots.get_mut(first..first + count)?.iter_mut().enumerate() {
                *slot = LeafSlot { triangle: order[first + lane], lane: lane as u8, leaf_len: count as u8 };
            }
        }
    }
    let is_known = |slot: &LeafSlot| slot.leaf_len > 0 && (slot.triangle as usize) < triangles;
    (!nodes.is_empty() && slots.iter().all(is_known)).then_some(slots)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKETS: TreeFor = TreeFor::Packets;

    /// As many triangles as are worth a file, in a row.
    fn row(shift: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let positions =
            (0..LEAST_TRIANGLES + 2).map(|i| Vec3::new(i as f32, (i % 2) as f32 + shift, 0.0)).collect();
        (positions, (0..LEAST_TRIANGLES as u32).map(|i| [i, i + 1, i + 2]).collect())
    }

    fn files(folder: &Path) -> Vec<PathBuf> {
        fs::read_dir(folder).map(|entries| entries.map(|e| e.unwrap().path()).collect()).unwrap_or_default()
    }

    #[test]
    fn trees_are_found_again_and_damaged_ones_built_anew() {
        let folder = tempfile::tempdir().unwrap();
        let cache = TreeCache::in_folder(folder.path().join("a/trees"));
        let (positions, triangles) = row(0.0);
        let ask =
            || cache.find_or(PACKETS, &positions, &triangles, || WideBvh::build(&positions, &triangles));
        let (built, found) = ask();
        assert!(!found);
        built.validate(&positions, &triangles).unwrap();
        assert_eq!(ask(), (built.clone(), true));

        let path = files(&folder.path().join("a/trees")).pop().unwrap();
        let whole = fs::read(&path).unwrap();
        let mut damaged: Vec<Vec<u8>> =
            vec![Vec::new(), whole[..20].to_vec(), whole[..whole.len() - 1].to_vec()];
        damaged.push([&whole[..], b"x"].concat());
        for at in [3, 12, 27, 35, HEADER + 5, whole.len() - 2] {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x40;
            damaged.push(bytes);
        }
        for bytes in damaged {
            fs::write(&path, &bytes).unwrap();
            assert_eq!(ask(), (built.clone(), false), "{} bytes", bytes.len());
            assert_eq!(fs::read(&path).unwrap(), whole, "replaced by a whole one");
        }
        // A terabyte that takes no room on the disk, and as long as it says itself.
        let nodes = (1u64 << 40) / size_of::<WideNode>() as u64;
        fs::write(&path, [&whole[..24], &nodes.to_le_bytes(), &0u64.to_le_bytes()].concat()).unwrap();
        let sparse = fs::OpenOptions::new().write(true).open(&path).unwrap();
        sparse.set_len(HEADER as u64 + nodes * size_of::<WideNode>() as u64).unwrap();
        assert_eq!(ask(), (built.clone(), false));
        let (moved, _) = row(1.0);
        assert!(
            !cache.find_or(PACKETS, &moved, &triangles, || WideBvh::build(&moved, &triangles)).1,
            "another scene"
        );
    }

    #[test]
    fn each_walker_finds_its_own_tree() {
        let folder = tempfile::tempdir().unwrap();
        let cache = TreeCache::in_folder(folder.path().to_path_buf());
        let (positions, triangles) = row(0.0);
        let ask = |tree_for| {
            let build = || WideBvh::build_for(tree_for, &positions, &triangles, &|_| ());
            cache.find_or(tree_for, &positions, &triangles, build)
        };
        let kinds = [TreeFor::Packets, TreeFor::SingleRays];
        let built = kinds.map(|tree_for| ask(tree_for).0);
        assert_ne!(built[0], built[1]);
        for (tree_for, tree) in kinds.into_iter().zip(built) {
            assert_eq!(ask(tree_for), (tree, true));
        }
        assert_eq!(files(folder.path()).len(), 2);
    }

    #[test]
    fn links_that_lead_nowhere_are_refused() {
        let (positions, triangles) = row(0.0);
        let tree = WideBvh::build(&positions, &triangles);
        let order: Vec<u32> = tree.order.iter().map(|slot| slot.triangle).collect();
        assert_eq!(slots(&tree.nodes, &order, triangles.len()).as_ref(), Some(&tree.order));
        assert_eq!(slots(&tree.nodes, &order, triangles.len() - 1), None);
        assert_eq!(slots(&tree.nodes, &order[1..], triangles.len()), None);
        let mut nodes = tree.nodes.clone();
        nodes[0].children[0] = 0;
        assert_eq!(slots(&nodes, &order, triangles.len()), None);
    }

    #[test]
    fn the_oldest_files_make_room() {
        let folder = tempfile::tempdir().unwrap();
        let mut cache = TreeCache::in_folder(folder.path().to_path_buf());
        let scenes = [0.0, 1.0, 2.0].map(row);
        let ask = |cache: &TreeCache, i: usize| {
            let (positions, triangles) = &scenes[i];
            cache.find_or(PACKETS, positions, triangles, || WideBvh::build(positions, triangles)).1
        };
        assert!(!ask(&cache, 0) && !ask(&cache, 1));
        let sizes = files(folder.path()).into_iter().map(|file| fs::metadata(file).unwrap().len());
        cache.most_bytes = sizes.sum();
        assert!(ask(&cache, 0), "used again: now the other is the oldest");
        assert!(!ask(&cache, 2));
        assert_eq!(files(folder.path()).len(), 2);
        assert!(ask(&cache, 0) && !ask(&cache, 1));
    }

    #[test]
    fn without_a_place_trees_are_built_all_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "in the way").unwrap();
        let (positions, triangles) = row(0.0);
        let cache = TreeCache::in_folder(file.join("trees"));
        for _ in 0..2 {
            assert!(
                !cache.find_or(PACKETS, &positions, &triangles, || WideBvh::build(&positions, &triangles)).1
            );
        }
    }
}
