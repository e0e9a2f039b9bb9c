//! What stands on a lot. All of it is in the lot's coordinates, 0..PITCH along x and z.

use super::blocks::{Block, Ground, PITCH, STREET, Site, WATER_LEVEL};
use crate::scene::generate::{Random, hash};

/// Height of the lookout's floor above the ground of the central lot.
pub(super) const LOOKOUT_HEIGHT: usize = 23;

const EDGE: i32 = PITCH as i32 - 1;
const START: i32 = STREET as i32;

/// Lays the ground of `lot` and builds on it.
pub(super) fn build_lot(site: &mut Site, lot: [i32; 2], ground: &Ground) {
    let wet = lay_ground(site, lot, ground);
    let level = ground.lot_level(lot) as i32 + 1;
    let mut random = Random::new(hash(&[lot[0] as u64, lot[1] as u64, ground.seed]));
    if wet {
        riverside(site, lot, ground, &mut random);
        return;
    }
    if random.unit() < 0.7 {
        street_lamp(site, lot, ground);
    }
    if lot == [0, 0] {
        return lookout(site, level);
    }
    match random.unit() {
        x if x < 0.11 => park(site, level, &mut random),
        x if x < 0.16 => market(site, level, &mut random),
        x if x < 0.22 => tower(site, level, &mut random),
        x if x < 0.25 => church(site, level),
        x if x < 0.62 => terrace(site, level, &mut random),
        _ => manor(site, level, &mut random),
    }
}

/// Returns whether the river flows through the lot.
fn lay_ground(site: &mut Site, lot: [i32; 2], ground: &Ground) -> bool {
    let corner = lot.map(|l| l * PITCH as i32 - PITCH as i32 / 2);
    let place = |x: i32, z: i32| (corner[0] + x, corner[1] + z);
    let wet = (0..PITCH as i32).any(|x| {
        [0, 10, EDGE].iter().any(|&z| {
            let (x, z) = place(x, z);
            ground.river_distance(x, z) < 12.0
        })
    });
    let shared = ground.lot_level(lot) as i32;
    for x in 0..PITCH as i32 {
        for z in 0..PITCH as i32 {
            let street = x < START || z < START;
            let (wx, wz) = place(x, z);
            let own = ground.level(wx, wz) as i32;
            let level = if street || wet { own } else { shared };
            let top = match () {
                _ if own < WATER_LEVEL as i32 || (wet && ground.river_distance(wx, wz) < 13.0) => Block::SAND,
                _ if street => Block::COBBLE,
                _ => Block::GRASS,
            };
            site.fill([x, 0, z], [x, level - 1, z], Block::DIRT);
            site.put([x, level, z], top);
            if level < WATER_LEVEL as i32 {
                site.fill([x, level + 1, z], [x, WATER_LEVEL as i32, z], Block::WATER);
            }
        }
    }
    wet
}

/// Bridges, boats and trees along the water.
fn riverside(site: &mut Site, lot: [i32; 2], ground: &Ground, random: &mut Random) {
    let corner = lot.map(|l| l * PITCH as i32 - PITCH as i32 / 2);
    let depth = |x: i32, z: i32| ground.river_distance(corner[0] + x, corner[1] + z);
    let deck = WATER_LEVEL as i32 + 2;
    if lot[0].rem_euclid(3) == 0 {
        for z in 0..PITCH as i32 {
            if depth(1, z) < 14.0 {
                site.fill([0, deck, z], [START - 1, deck, z], Block::PLANKS);
                for x in [0, START - 1] {
                    let pier = z % 5 == 0;
                    site.fill([x, if pier { 0 } else { deck + 1 }, z], [x, deck + 1, z], Block::STONE);
                }
            }
        }
    }
    let (x, z) = (random.range(7.0, 12.0) as i32, random.range(5.0, 15.0) as i32);
    if depth(x, z) < 7.0 && depth(x + 6, z) < 7.0 {
        boat(site, [x, WATER_LEVEL as i32, z]);
    } else if depth(x, z) > 15.0 {
        let level = ground.level(corner[0] + x, corner[1] + z) as i32 + 1;
        tree(site, [x, level, z], random);
    }
}

fn boat(site: &mut Site, [x, y, z]: [i32; 3]) {
    site.fill([x, y, z - 1], [x + 5, y + 1, z + 1], Block::PLANKS);
    site.fill([x + 1, y + 1, z], [x + 4, y + 1, z], Block::AIR);
    site.fill([x + 3, y + 1, z], [x + 3, y + 7, z], Block::TIMBER);
    site.fill([x + 1, y + 4, z], [x + 2, y + 6, z], Block::WHITE);
}

fn street_lamp(site: &mut Site, lot: [i32; 2], ground: &Ground) {
    let half = PITCH as i32 / 2;
    let level = ground.level(lot[0] * PITCH as i32 - half + 3, lot[1] * PITCH as i32 - half + 3) as i32;
    site.fill([3, level + 1, 3], [3, level + 3, 3], Block::TIMBER);
    site.put([3, level + 4, 3], Block::LAMP);
}

/// A tower with a flat top, open to all sides: the viewer stands on it.
fn lookout(site: &mut Site, level: i32) {
    let (low, high) = (START + 3, EDGE - 3);
    let top = level + LOOKOUT_HEIGHT as i32 - 1;
    walls(site, [low, level, low], [high, top, high], Block::STONE, Block::STONE);
    site.fill([low - 1, top, low - 1], [high + 1, top, high + 1], Block::STONE);
    for (x, z) in [(low - 1, low - 1), (high + 1, low - 1), (low - 1, high + 1)] {
        site.fill([x, top + 1, z], [x, top + 2, z], Block::STONE);
        site.put([x, top + 3, z], Block::LAMP);
    }
    site.fill([START, level, START], [EDGE, level - 1, EDGE], Block::COBBLE);
}

fn park(site: &mut Site, level: i32, random: &mut Random) {
    let middle = (START + EDGE) / 2;
    site.fill([middle, level - 1, START], [middle + 1, level - 1, EDGE], Block::SAND);
    site.fill([START, level - 1, middle], [EDGE, level - 1, middle + 1], Block::SAND);
    site.fill([middle - 1, level - 1, middle - 1], [middle + 2, level - 1, middle + 2], Block::STONE);
    site.fill([middle, level - 1, middle], [middle + 1, level - 1, middle + 1], Block::WATER);
    for (x, z) in [(START + 3, START + 3), (EDGE - 3, START + 3), (START + 3, EDGE - 3), (EDGE - 3, EDGE - 3)]
    {
        tree(site, [x, level, z], random);
    }
}

fn tree(site: &mut Site, [x, y, z]: [i32; 3], random: &mut Random) {
    let trunk = random.range(4.0, 7.0) as i32;
    let radius = random.range(2.2, 3.4);
    let reach = radius.ceil() as i32;
    for dx in -reach..=reach {
        for dy in -reach..=reach {
            for dz in -reach..=reach {
                let distance = ((dx * dx + dz * dz) as f32 + 1.3 * (dy * dy) as f32).sqrt();
                if distance < radius - 0.6 * random.unit() {
                    site.put([x + dx, y + trunk + dy + 1, z + dz], Block::LEAVES);
                }
            }
        }
    }
    site.fill([x, y, z], [x, y + trunk, z], Block::TIMBER);
}

fn market(site: &mut Site, level: i32, random: &mut Random) {
    site.fill([START, level - 1, START], [EDGE, level - 1, EDGE], Block::COBBLE);
    for x in [START + 2, START + 7, START + 12] {
        for z in [START + 2, START + 7, START + 12] {
            let cloth =
                [Block::TILES, Block::WHITE, Block::OCHRE, Block::SLATE][(random.unit() * 4.0) as usize];
            for (px, pz) in [(x, z), (x + 2, z), (x, z + 2), (x + 2, z + 2)] {
                site.fill([px, level, pz], [px, level + 2, pz], Block::TIMBER);
            }
            site.fill([x, level, z + 1], [x + 2, level, z + 1], Block::PLANKS);
            site.fill([x, level + 3, z], [x + 2, level + 3, z + 2], cloth);
        }
    }
}

fn tower(site: &mut Site, level: i32, random: &mut Random) {
    let (low, high) = (START + 4, EDGE - 4);
    let top = level + random.range(16.0, 30.0) as i32;
    storeys(site, [low, level, low], [high, top, high], Block::STONE, Block::STONE);
    site.fill([low - 1, top, low - 1], [high + 1, top, high + 1], Block::STONE);
    for i in (low - 1..=high + 1).step_by(2) {
        for side in [low - 1, high + 1] {
            site.put([i, top + 1, side], Block::STONE);
            site.put([side, top + 1, i], Block::STONE);
        }
    }
    spire(site, [low, top + 1, low], [high, top + 1, high], Block::SLATE);
}

fn church(site: &mut Site, level: i32) {
    let (low, high) = (START + 3, EDGE - 3);
    storeys(site, [low, level, START + 5], [high, level + 7, EDGE], Block::WHITE, Block::STONE);
    gable(site, [low, level + 8, START + 5], [high, level + 8, EDGE], Block::SLATE, Block::WHITE);
    let (left, right) = (low + 2, high - 2);
    storeys(site, [left, level, START], [right, level + 22, START + 5], Block::WHITE, Block::STONE);
    spire(site, [left, level + 23, START], [right, level + 23, START + 5], Block::SLATE);
}

/// Two or three narrow houses side by side.
fn terrace(site: &mut Site, level: i32, random: &mut Random) {
    let houses = 2 + (random.unit() * 2.0) as i32;
    let width = (PITCH as i32 - START) / houses;
    for i in 0..houses {
        let low = START + i * width;
        let back = EDGE - random.range(0.0, 5.0) as i32;
        house(site, [low, level, START + 1], [low + width - 1, back], random);
    }
}

/// One large house with a garden.
fn manor(site: &mut Site, level: i32, random: &mut Random) {
    let low = START + 1 + random.range(0.0, 3.0) as i32;
    let high = EDGE - 1 - random.range(0.0, 3.0) as i32;
    let back = EDGE - random.range(3.0, 7.0) as i32;
    house(site, [low, level, START + 1], [high, back], random);
    if back < EDGE - 5 {
        tree(site, [(low + high) / 2, level, EDGE - 2], random);
    }
    for x in (START..=EDGE).filter(|x| x % 2 == 0) {
        site.put([x, level, EDGE], Block::LEAVES);
    }
}

fn house(site: &mut Site, low: [i32; 3], high: [i32; 2], random: &mut Random) {
    let wall = [Block::WHITE, Block::OCHRE, Block::BRICK, Block::WHITE][(random.unit() * 4.0) as usize];
    let roof = if random.unit() < 0.7 { Block::TILES } else { Block::SLATE };
    let frame = if wall == Block::BRICK { Block::STONE } else { Block::TIMBER };
    let top = low[1] + 4 * random.range(2.0, 4.99) as i32 - 1;
    let high = [high[0], top, high[1]];
    storeys(site, low, high, wall, frame);
    let above = |corner: [i32; 3]| [corner[0], top + 1, corner[2]];
    gable(site, above(low), above(high), roof, wall);
    site.fill([low[0] + 1, top, low[2] + 2], [low[0] + 1, top + 5, low[2] + 2], Block::BRICK);
}

/// Four walls with corner posts and a door; `low` and `high` are corners inside the walls' blocks.
fn walls(site: &mut Site, low: [i32; 3], high: [i32; 3], wall: Block, frame: Block) {
    for (x0, x1, z0, z1) in [
        (low[0], high[0], low[2], low[2]),
        (low[0], high[0], high[2], high[2]),
        (low[0], low[0], low[2], high[2]),
        (high[0], high[0], low[2], high[2]),
    ] {
        site.fill([x0, low[1], z0], [x1, high[1], z1], wall);
    }
    for (x, z) in [(low[0], low[2]), (high[0], low[2]), (low[0], high[2]), (high[0], high[2])] {
        site.fill([x, low[1], z], [x, high[1], z], frame);
    }
    let door = (low[0] + high[0]) / 2;
    site.fill([door, low[1], low[2]], [door, low[1] + 1, low[2]], Block::AIR);
}

/// A building of rooms: storeys of four blocks, with floors and windows.
fn storeys(site: &mut Site, low: [i32; 3], high: [i32; 3], wall: Block, frame: Block) {
    walls(site, low, high, wall, frame);
    let mut floor = low[1];
    while floor <= high[1] {
        if floor > low[1] {
            site.fill([low[0] + 1, floor, low[2] + 1], [high[0] - 1, floor, high[2] - 1], Block::PLANKS);
            for (z, x0, x1) in [(low[2], low[0], high[0]), (high[2], low[0], high[0])] {
                site.fill([x0, floor, z], [x1, floor, z], frame);
            }
            windows(site, [low[0], floor + 1, low[2]], high);
        } else {
            windows(site, [low[0], floor + 1, low[2] - 1], high);
        }
        // A lamp under every other ceiling lights rooms behind open doors.
        site.put([(low[0] + high[0]) / 2, (floor + 3).min(high[1]), (low[2] + high[2]) / 2], Block::LAMP);
        floor += 4;
    }
    site.fill([low[0], high[1], low[2]], [high[0], high[1], high[2]], Block::PLANKS);
}

/// Windows two blocks high in the four walls of a storey; a front outside of the building has none.
fn windows(site: &mut Site, low: [i32; 3], high: [i32; 3]) {
    let top = (low[1] + 1).min(high[1] - 1);
    let front = high[2].min(low[2] + 1) > low[2] && low[2] >= START;
    for x in (low[0] + 2..high[0] - 1).step_by(3) {
        if front {
            site.fill([x, low[1], low[2]], [x, top, low[2]], Block::GLASS);
        }
        site.fill([x, low[1], high[2]], [x, top, high[2]], Block::GLASS);
    }
    for z in (low[2] + 3..high[2] - 1).step_by(3) {
        site.fill([low[0], low[1], z], [low[0], top, z], Block::GLASS);
        site.fill([high[0], low[1], z], [high[0], top, z], Block::GLASS);
    }
}

/// A roof whose ridge runs along z; its ends are walls.
fn gable(site: &mut Site, low: [i32; 3], high: [i32; 3], roof: Block, wall: Block) {
    let mut i = 0;
    while low[0] + i <= high[0] - i {
        let (left, right, y) = (low[0] + i, high[0] - i, low[1] + i);
        for x in [left, right] {
            site.fill([x, y, low[2] - 1], [x, y, high[2]], roof);
        }
        for z in [low[2], high[2]] {
            site.fill([left + 1, y, z], [right - 1, y, z], wall);
        }
        i += 1;
    }
}

/// A steep roof with four sides: two blocks up for one inwards.
fn spire(site: &mut Site, low: [i32; 3], high: [i32; 3], roof: Block) {
    let mut i = 0;
    while low[0] + i <= high[0] - i && low[2] + i <= high[2] - i {
        let y = low[1] + 2 * i;
        site.fill([low[0] + i, y, low[2] + i], [high[0] - i, y + 1, high[2] - i], roof);
        i += 1;
    }
}
