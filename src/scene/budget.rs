//! What loading a scene may take: estimated before it is taken, and compared with the memory that is free.
//!
//! Small files can unfold to any size: pictures of one colour, instances of instances, one file named many
//! times. Each stage of loading tells here what it is about to take; what does not fit is refused in a sentence
//! that says what takes how much.
//!
//! **A budget before memory.** A file of kilobytes can ask for any amount of memory: pictures of one colour,
//! instances of instances, `{}` a million times. Lists are counted before they are parsed
//! (`src/scene/gltf/weigh.rs`), pictures by their headers, triangles by their nodes; only then is anything
//! made.

use std::sync::Mutex;

/// Bytes that a triangle takes when all instances are placed and a tree is built over them: vertices twice
/// while they are joined, the tree while it is built, and both as devices hold them: the sum of those
/// lists' entries, not a measurement.
const TRIANGLE: u64 = 480;

/// Bytes that a place of a primitive takes at most: its matrix, as read and as devices hold it, and what of the tree
/// leads to it, while it is built, compact, and on devices.
const INSTANCE: u64 = 2000;

/// Bytes that a texel takes: as decoded, with all smaller levels, and again as devices hold it.
const TEXEL: f64 = 4.0 * 4.0 / 3.0 * 2.0;

/// Texels of all pictures together at most, before smaller levels are made: devices tell 2^32 apart.
const MOST_TEXELS: u64 = 3 << 30;

/// Pictures are not made smaller than so many texels for want of memory.
pub const SMALLEST: u64 = 1 << 12;

/// Share of the free memory that a scene may take.
const SHARE: f64 = 0.9;

/// What a scene was found to need so far.
#[derive(Debug)]
pub struct Budget {
    free: u64,
    needs: Mutex<Needs>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Needs {
    document: u64,
    bytes: u64,
    instances: u64,
    triangles: u64,
    textures: u64,
}

impl Budget {
    /// For the memory that this process may still take.
    pub fn of_machine() -> Self {
        Self::with_free(crate::free_memory::bytes().unwrap_or(u64::MAX))
    }

    /// For so many bytes of free memory.
    pub fn with_free(free: u64) -> Self {
        Budget { free, needs: Mutex::default() }
    }

    /// Plans lists that are parsed from a scene's text.
    ///
    /// # Errors
    /// As all of these: where it does not fit beside what was planned before, with the reason.
    pub fn plan_document(&self, bytes: u64) -> Result<(), String> {
        self.plan(|needs| needs.document += bytes)
    }

    /// Plans files that are held in memory.
    #[allow(clippy::missing_errors_doc)]
    pub fn plan_bytes(&self, bytes: u64) -> Result<(), String> {
        self.plan(|needs| needs.bytes += bytes)
    }

    /// Plans places of primitives.
    #[allow(clippy::missing_errors_doc)]
    pub fn plan_instances(&self, instances: u64) -> Result<(), String> {
        self.plan(|needs| needs.instances += instances.saturating_mul(INSTANCE))
    }

    /// Plans triangles: of all instances but those that share a shape.
    #[allow(clippy::missing_errors_doc)]
    pub fn plan_triangles(&self, triangles: u64) -> Result<(), String> {
        self.plan(|needs| needs.triangles += triangles.saturating_mul(TRIANGLE))
    }

    /// Plans pictures of these numbers of texels; returns how often the edges of each are halved so that all fit.
    /// The largest are halved first.
    ///
    /// # Errors
    /// Where they do not fit as small as [`SMALLEST`] either.
    pub fn plan_textures(&self, texels: &[u64]) -> Result<Vec<u32>, String> {
        let mut halvings = vec![0; texels.len()];
        let size = |i: usize, halvings: &[u32]| texels[i] >> (2 * halvings[i]);
        let bytes = |halvings: &[u32]| {
            let sum = (0..texels.len()).map(|i| size(i, halvings)).fold(0, u64::saturating_add);
            (sum.min(u64::MAX / 64) as f64 * TEXEL) as u64
        };
        let room = self.room();
        let most = room.min((MOST_TEXELS as f64 * TEXEL) as u64);
        while bytes(&halvings) > most {
            let largest = (0..texels.len()).map(|i| size(i, &halvings)).max().unwrap_or(0);
            if largest <= SMALLEST {
                break;
            }
            let large: Vec<usize> = (0..texels.len()).filter(|&i| size(i, &halvings) > largest / 4).collect();
            large.into_iter().for_each(|i| halvings[i] += 1);
        }
        self.plan(|needs| needs.textures += bytes(&halvings))?;
        Ok(halvings)
    }

    /// Bytes that are not planned for.
    fn room(&self) -> u64 {
        let needs = self.needs.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        ((self.free as f64 * SHARE) as u64).saturating_sub(needs.total())
    }

    fn plan(&self, add: impl FnOnce(&mut Needs)) -> Result<(), String> {
        let mut needs = self.needs.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        add(&mut needs);
        let allowed = (self.free as f64 * SHARE) as u64;
        if needs.total() <= allowed { Ok(()) } else { Err(needs.refusal(allowed)) }
    }
}

impl Needs {
    fn total(&self) -> u64 {
        [self.document, self.bytes, self.instances, self.triangles, self.textures]
            .into_iter()
            .fold(0, u64::saturating_add)
    }

    fn refusal(&self, allowed: u64) -> String {
        let parts = [
            (self.textures, "textures", "scale its largest textures down"),
            (self.triangles, "triangles", "show less of it"),
            (self.bytes, "buffers", "show less of it"),
            (self.instances, "instances", "show less of it"),
            (self.document, "lists of nodes and materials", "merge some of them"),
        ];
        let told: Vec<String> = parts
            .iter()
            .filter(|part| part.0 > 0)
            .map(|part| format!("{} for {}", gigabytes(part.0), part.1))
            .collect();
        let way = parts.iter().max_by_key(|part| part.0).map_or("show less of it", |part| part.2);
        format!(
            "it would take {} of memory ({}), but {} may be taken here; {way}, or free some memory",
            gigabytes(self.total()),
            told.join(", "),
            gigabytes(allowed)
        )
    }
}

fn gigabytes(bytes: u64) -> String {
    format!("{:.2} GB", bytes as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused_with_its_largest_part_and_the_way() {
        let budget = Budget::with_free(10_000_000_000);
        assert_eq!(budget.plan_bytes(1_000_000_000), Ok(()));
        assert_eq!(budget.plan_triangles(10_000_000), Ok(()));
        let refusal = budget.plan_triangles(10_000_000).unwrap_err();
        for part in
            ["10.60 GB", "9.60 GB for triangles", "1.00 GB for buffers", "9.00 GB may", "show less of it"]
        {
            assert!(refusal.contains(part), "{part}: {refusal}");
        }
        let refusal = Budget::with_free(1 << 30).plan_triangles(u64::MAX / 2).unwrap_err();
        assert!(refusal.contains("show less of it"), "{refusal}");
    }
    #[test]
    fn textures_are_halved_from_the_largest_on_until_they_fit() {
        let texels = [1 << 24, 1 << 22, 1 << 18];
        let plan = |free: u64| Budget::with_free(free).plan_textures(&texels);
        assert_eq!(plan(1 << 32), Ok(vec![0, 0, 0]));
        // All take 227 MB; with the largest halved 91 MB, and with two 48 MB.
        assert_eq!(plan(150_000_000), Ok(vec![1, 0, 0]));
        assert_eq!(plan(40_000_000), Ok(vec![2, 1, 0]));
        let refusal = plan(1000).unwrap_err();
        assert!(refusal.contains("for textures"), "{refusal}");
    }
}
