//! Images that are put together from others: masks, and heights that become normals.

use glam::DVec3;

use crate::scene::texture::Image;

/// Takes the coverage of an image from a mask of any size; `white` drops the image's own colours.
pub fn cut_out(image: &mut Image, mask: &Image, white: bool) {
    let channel = coverage(mask);
    let (width, height) = (image.width as usize, image.height as usize);
    for (i, texel) in image.texels.iter_mut().enumerate() {
        let x = (i % width) * mask.width as usize / width;
        let y = (i / width) * mask.height as usize / height;
        let alpha = mask.texels[y * mask.width as usize + x][channel];
        let [r, g, b, _] = if white { [255; 4] } else { *texel };
        *texel = [r, g, b, alpha];
    }
}

/// The same with the image as its own mask.
pub fn cut_out_itself(image: &mut Image) {
    let channel = coverage(image);
    image.texels.iter_mut().for_each(|texel| texel[3] = texel[channel]);
}

/// Where a mask says what it covers: in its alpha if it has any, else in its brightness.
fn coverage(mask: &Image) -> usize {
    if mask.texels.iter().any(|texel| texel[3] < 255) { 3 } else { 0 }
}

/// Makes a tangent-space normal map of a grey image, whose brightness is height: a step from black to white
/// between two texels is `height` texels high. One that is not grey is taken for a normal map already.
pub fn normals_of_heights(image: &mut Image, height: f64) {
    if image.texels.iter().any(|texel| texel[0] != texel[1] || texel[1] != texel[2]) {
        return;
    }
    let (width, rows) = (image.width as usize, image.height as usize);
    let heights: Vec<u8> = image.texels.iter().map(|texel| texel[0]).collect();
    let at = |x: usize, y: usize| f64::from(heights[y % rows * width + x % width]) / 255.0 * height;
    for (i, texel) in image.texels.iter_mut().enumerate() {
        let (x, y) = (i % width, i / width);
        let across = (at(x + 1, y) - at(x + width - 1, y)) * 0.5;
        // Rows go down, and the map's Y up.
        let up = (at(x, y + rows - 1) - at(x, y + 1)) * 0.5;
        let normal = DVec3::new(-across, -up, 1.0).normalize();
        let code = |c: f64| ((c * 0.5 + 0.5) * 255.0).round() as u8;
        *texel = [code(normal.x), code(normal.y), code(normal.z), 255];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[u8], width: u32) -> Image {
        let texels: Vec<[u8; 4]> = values.iter().map(|&v| [v, v, v, 255]).collect();
        Image { height: texels.len() as u32 / width, texels, width }
    }

    #[test]
    fn masks_of_any_size_cut_out() {
        let mut image = grey(&[10, 20, 30, 40], 4);
        cut_out(&mut image, &grey(&[0, 255], 2), false);
        assert_eq!(image.texels, [[10, 10, 10, 0], [20, 20, 20, 0], [30, 30, 30, 255], [40, 40, 40, 255]]);
        cut_out(&mut image, &grey(&[7], 1), true);
        assert_eq!(image.texels, [[255, 255, 255, 7]; 4]);
        let mut own = grey(&[9, 200], 2);
        cut_out_itself(&mut own);
        assert_eq!(own.texels, [[9, 9, 9, 9], [200, 200, 200, 200]]);
    }

    #[test]
    fn heights_become_normals_that_lean_away_from_what_is_higher() {
        let mut ramp = grey(&[0, 51, 102, 0, 51, 102, 0, 51, 102], 3);
        normals_of_heights(&mut ramp, 5.0);
        // In the middle the height rises by 1 in each texel along x.
        let [x, y, z, _] = ramp.texels[4].map(|c| f64::from(c) / 255.0 * 2.0 - 1.0);
        assert!((x + 0.5_f64.sqrt()).abs() < 0.01 && y.abs() < 0.01 && (z - 0.5_f64.sqrt()).abs() < 0.01);
        let mut down = grey(&[0, 0, 0, 51, 51, 51, 102, 102, 102], 3);
        normals_of_heights(&mut down, 5.0);
        assert!(down.texels[4][1] > 200, "what rises downwards leans up: {:?}", down.texels[4]);
        let mut color = Image { texels: vec![[1, 2, 3, 4]], width: 1, height: 1 };
        normals_of_heights(&mut color, 1.0);
        assert_eq!(color.texels, [[1, 2, 3, 4]]);
    }
}
