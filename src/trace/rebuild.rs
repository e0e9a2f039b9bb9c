//! New trees for parts whose motion has made their refitted ones slow, built while frames go on.

use std::sync::mpsc::{Receiver, channel};

use crate::bvh::{Parted, WideBvh};

/// A part gets a new tree where rays visit so many times as much as when its tree was built.
pub(super) const GROWTH: f64 = 1.08;
/// A tree that was asked for is taken after so many instants, and one more for so many triangles: late enough to be
/// ready, and not as soon as it is, so that it does not depend on how busy the machine is which picture is the first to
/// be traced with it.
const DELAY: u64 = 20;
const TRIANGLES_AN_INSTANT: usize = 2000;

/// A look at a part in a thread of its own.
pub(super) type Look = Box<dyn FnOnce() -> Seen + Send>;

/// What came of it.
pub(super) struct Seen {
    /// How many times as much rays visit there as when the part's tree was built; `None` where the part's tree itself tells.
    pub growth: Option<f64>,
    /// Another tree, where that pays.
    pub tree: Option<WideBvh>,
}

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
    seen: Receiver<Seen>,
    due: u64,
}

impl Rebuild {
    /// Looks after the parts at an instant, after their refit. `look` tells how a part is looked at, where there is need:
    /// it gets its number, and by how much it has to have grown. `triangles` tells its first triangle and how many it has.
    /// Returns the part that has a new tree, which is to be refitted, if any has.
    pub fn look_after(
        &mut self,
        serial: u64,
        parted: &mut Parted,
        look: impl Fn(&Parted, usize, f64) -> Option<Look>,
        triangles: impl Fn(usize) -> (usize, usize),
    ) -> Option<usize> {
        let count = parted.parts.len();
        self.kept.resize(count, 1.0);
        if let Some(due) = self.under_way.take_if(|under_way| under_way.due <= serial) {
            // A thread that is gone has left nothing: the old tree goes on.
            let Seen { growth, tree: Some(tree) } = due.seen.recv().ok()? else { return None };
            let before = growth.unwrap_or_else(|| parted.parts[due.part].growth());
            let is_taken = parted.replace(due.part, tree, triangles(due.part).0);
            self.kept[due.part] = if is_taken { 1.0 } else { before };
            return is_taken.then_some(due.part);
        }
        if self.under_way.is_some() || count == 0 {
            return None;
        }
        // One part an instant, so that a thousand of them cost no more.
        let part = self.next % count;
        self.next = part + 1;
        if let Some(look) = look(parted, part, GROWTH * self.kept[part]) {
            let due = serial + DELAY + (triangles(part).1 / TRIANGLES_AN_INSTANT) as u64;
            let (sender, seen) = channel();
            let build = move || drop(sender.send(look()));
            if std::thread::Builder::new().name("new tree".into()).spawn(build).is_ok() {
                self.under_way = Some(UnderWay { part, seen, due });
            }
        }
        None
    }
}
