//! The blocks of the town and the ground they stand on.

use glam::DVec3;
use rayon::prelude::*;

use super::lots::build_lot;
use crate::scene::generate::paint::cell;

/// Blocks from street to street.
pub(super) const PITCH: usize = 20;
/// Width of a street: the first blocks of a lot along both axes.
pub(super) const STREET: usize = 4;
/// Blocks from bottom to top.
pub(super) const HEIGHT: usize = 80;
/// Height of the river's uppermost block.
pub(super) const WATER_LEVEL: usize = 5;

/// What fills a place: air, or a material of the palette.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block(u8);

impl Block {
    pub(super) const AIR: Block = Block(0);
    pub(super) const GRASS: Block = Block(1);
    pub(super) const DIRT: Block = Block(2);
    pub(super) const COBBLE: Block = Block(3);
    pub(super) const STONE: Block = Block(4);
    pub(super) const WHITE: Block = Block(5);
    pub(super) const OCHRE: Block = Block(6);
    pub(super) const BRICK: Block = Block(7);
    pub(super) const TIMBER: Block = Block(8);
    pub(super) const PLANKS: Block = Block(9);
    pub(super) const TILES: Block = Block(10);
    pub(super) const SLATE: Block = Block(11);
    pub(super) const WATER: Block = Block(12);
    pub(super) const LEAVES: Block = Block(13);
    pub(super) const GLASS: Block = Block(14);
    pub(super) const SAND: Block = Block(15);
    pub(super) const LAMP: Block = Block(16);

    /// Index into the palette; air has none.
    pub(super) fn material(self) -> usize {
        usize::from(self.0) - 1
    }

    /// Whether a side of this block is seen when `other` is before it: leaves have holes.
    pub(super) fn shows_against(self, other: Block) -> bool {
        other == Block::AIR || (other == Block::LEAVES && self != Block::LEAVES)
    }
}

/// A square of lots around the centre.
pub(super) struct World {
    /// Rings of lots around the central one.
    pub(super) rings: usize,
    /// Blocks along an edge.
    pub(super) size: usize,
    blocks: Vec<Block>,
    ground: Ground,
}

impl World {
    pub(super) fn new(rings: usize, seed: u64) -> Self {
        let lots = 2 * rings + 1;
        let size = lots * PITCH;
        let ground = Ground { seed };
        let mut blocks = vec![Block::AIR; size * size * HEIGHT];
        // One strip of lots for each step along x: nothing that is built reaches beyond its lot.
        blocks.par_chunks_mut(PITCH * size * HEIGHT).enumerate().for_each(|(i, strip)| {
            for j in 0..lots {
                let lot = [i, j].map(|l| l as i32 - rings as i32);
                let mut site = Site { strip, size, start: j * PITCH };
                build_lot(&mut site, lot, &ground);
            }
        });
        World { rings, size, blocks, ground }
    }

    pub(super) fn block(&self, x: usize, y: usize, z: usize) -> Block {
        self.blocks[(x * self.size + z) * HEIGHT + y]
    }

    /// The block beside one. Nothing is seen from below; above is air; beyond the edge all is hidden.
    pub(super) fn neighbour(&self, at: [usize; 3], step: [i32; 3]) -> Block {
        let [x, y, z] = [0, 1, 2].map(|axis| at[axis] as i32 + step[axis]);
        let size = self.size as i32;
        if y >= HEIGHT as i32 {
            return Block::AIR;
        }
        if y < 0 || x < 0 || z < 0 || x >= size || z >= size {
            return Block::STONE;
        }
        self.block(x as usize, y as usize, z as usize)
    }

    /// Where the viewer's eyes are: 1.6 m above the lookout of the central lot.
    pub(super) fn lookout(&self) -> DVec3 {
        let level = self.ground.lot_level([0, 0]) + super::lots::LOOKOUT_HEIGHT + 1;
        // Near the open corner of its floor: the town below is in view.
        let place = PITCH as f64 / 2.0 - 3.2;
        DVec3::new(place, level as f64 + 1.6, place)
    }
}

/// One lot while it is built: coordinates 0..PITCH along x and z.
pub(super) struct Site<'a> {
    strip: &'a mut [Block],
    size: usize,
    start: usize,
}

impl Site<'_> {
    /// Puts a block; outside of the lot nothing happens.
    pub(super) fn put(&mut self, [x, y, z]: [i32; 3], block: Block) {
        let inside = |v: i32, end: usize| v >= 0 && v < end as i32;
        if inside(x, PITCH) && inside(z, PITCH) && inside(y, HEIGHT) {
            self.strip[(x as usize * self.size + self.start + z as usize) * HEIGHT + y as usize] = block;
        }
    }

    /// Fills a box, both corners included.
    pub(super) fn fill(&mut self, low: [i32; 3], high: [i32; 3], block: Block) {
        for x in low[0]..=high[0] {
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    self.put([x, y, z], block);
                }
            }
        }
    }
}

/// The shape of the land.
pub(super) struct Ground {
    pub(super) seed: u64,
}

impl Ground {
    /// Distance along z from the middle of the river, in blocks.
    pub(super) fn river_distance(&self, x: i32, z: i32) -> f64 {
        let x = f64::from(x);
        (f64::from(z) - 46.0 * (x / 140.0).sin() - 20.0 * (x / 53.0 + 1.0).sin() - 28.0).abs()
    }

    /// Height of the uppermost block of land.
    pub(super) fn level(&self, x: i32, z: i32) -> usize {
        let bank = (self.river_distance(x, z) - 10.0) / 170.0;
        if bank < 0.0 {
            return WATER_LEVEL - 3;
        }
        let bank = bank.min(1.0);
        let hills = self.waves(x, z, 190.0, 0) * 26.0 + self.waves(x, z, 60.0, 1) * 6.0;
        7 + (bank * bank * (3.0 - 2.0 * bank) * hills) as usize
    }

    /// The level that the buildings of a lot share.
    pub(super) fn lot_level(&self, [x, z]: [i32; 2]) -> usize {
        let middle = |l: i32| l * PITCH as i32 + 2;
        self.level(middle(x), middle(z))
    }

    /// Smooth noise in 0..1 with cells of `size` blocks.
    fn waves(&self, x: i32, z: i32, size: f64, salt: u64) -> f64 {
        let p = [f64::from(x) / size, f64::from(z) / size];
        let base = p.map(f64::floor);
        let f = [0, 1].map(|i| {
            let t = p[i] - base[i];
            t * t * (3.0 - 2.0 * t)
        });
        let at = |dx: i64, dz: i64| {
            f64::from(cell(base[0] as i64 + dx, base[1] as i64 + dz, self.seed.wrapping_mul(2) + salt))
        };
        let near = at(0, 0) + (at(1, 0) - at(0, 0)) * f[0];
        let far = at(0, 1) + (at(1, 1) - at(0, 1)) * f[0];
        near + (far - near) * f[1]
    }
}
