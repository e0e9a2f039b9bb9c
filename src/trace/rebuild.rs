//! New trees for parts whose motion has made their refitted ones slow, built while frames go on.

use std::ops::Range;
use std::sync::mpsc::{Receiver, channel};

use glam::Vec3;

use crate::bvh::part_tree::PartTree;
use crate::bvh::{Parted, WideBvh};

/// A part gets a new tree where rays visit so many times as much as when its tree was built.
const GROWTH: f64 = 1.08;
/// A tree that was asked for is taken after so many instants, and one more for so many triangles: late enough to be
/// ready, and not as soon as it is, so that it does not depend on how busy the machine is which picture is the first to
/// be traced with it.
const DELAY: u64 = 20;
const TRIANGLES_AN_INSTANT: usize = 2000;

/// One tree at a time that is being built.
#[derive(Debug, Default)]
pub(super) struct Rebuild {
    under_way: Option<UnderWay>,
    /// The part that is looked at next.
    next: usize,
    /// What each part's new tree was worth, as a factor of what rays visited: one that gained nothing is not built anew
    /// before its part has grown by more than that.
    kept: Vec<f64>,
}

#[derive(Debug)]
struct UnderWay {
    part: usize,
    tree: Receiver<WideBvh>,
    due: u64,
}

impl Rebuild {
    /// Looks after the parts at an instant, after their refit; `triangles` are those of each part in terms of its
    /// vertices in `positions`, and `ranges` tells which of the mesh's these are. `may` says which parts may be built
    /// anew. Returns whether a part has a new tree, which is to be refitted.
    pub fn look_after(
        &mut self,
        serial: u64,
        parted: &mut Parted,
        own: &[Vec<[u32; 3]>],
        vertices: impl Fn(usize) -> Vec<Vec3>,
        ranges: impl Fn(usize) -> Range<usize>,
        may: impl Fn(usize) -> bool,
    ) -> bool {
        let count = parted.parts.len();
        self.kept.resize(count, 1.0);
        if let Some(due) = self.under_way.take_if(|under_way| under_way.due <= serial) {
            // A thread that is gone has left nothing: the old tree goes on.
            let Ok(tree) = due.tree.recv() else { return false };
            let before = parted.parts[due.part].growth();
            let is_taken = parted.replace(due.part, tree, ranges(due.part).start);
            self.kept[due.part] = if is_taken { 1.0 } else { before };
            return is_taken;
        }
        if self.under_way.is_some() || count == 0 {
            return false;
        }
        // One part an instant, so that a thousand of them cost no more.
        let part = self.next % count;
        self.next = part + 1;
        if may(part) && worn(&parted.parts[part], self.kept[part]) {
            let (positions, triangles) = (vertices(part), own[part].clone());
            let due = serial + DELAY + (triangles.len() / TRIANGLES_AN_INSTANT) as u64;
            let (sender, tree) = channel();
            let build = move || drop(sender.send(WideBvh::build_whole(&positions, &triangles)));
            if std::thread::Builder::new().name("new tree".into()).spawn(build).is_ok() {
                self.under_way = Some(UnderWay { part, tree, due });
            }
        }
        false
    }
}

fn worn(part: &PartTree, kept: f64) -> bool {
    part.growth() > GROWTH * kept
}
