//! An OBJ file's text as tobj takes it, and what can be told of it before it is parsed.

use std::io::{BufRead, Read};

/// Lines between two reports of progress.
const REPORT: usize = 1 << 16;

/// UTF-8 without continued lines. Names in other encodings, which are those of western Windows most often,
/// are read as Latin-1.
pub fn tidy(bytes: Vec<u8>) -> String {
    let text = String::from_utf8(bytes)
        .unwrap_or_else(|error| error.into_bytes().iter().map(|&byte| char::from(byte)).collect());
    if !text.contains("\\\n") && !text.contains("\\\r\n") {
        return text;
    }
    text.replace("\\\r\n", " ").replace("\\\n", " ")
}

/// At most so many triangles are in its faces.
pub fn triangles(text: &str) -> u64 {
    let corners = |line: &str| line.split_ascii_whitespace().count().saturating_sub(1) as u64;
    text.lines()
        .map(str::trim_start)
        .filter(|line| line.starts_with("f ") || line.starts_with("f\t"))
        .map(|line| corners(line).saturating_sub(2))
        .sum()
}

/// The first line, from 1, with a corner that counts back beyond the first vertex, or has a number that no vertex can
/// have: tobj computes with these before it looks whether they are there.
pub fn lost_corner(text: &str) -> Option<usize> {
    // Positions, texture coordinates and normals so far.
    let mut known = [0; 3];
    for (place, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => known[0] += 1,
            Some("vt") => known[1] += 1,
            Some("vn") => known[2] += 1,
            Some("f" | "l") => {
                let is_lost =
                    |corner: &str| corner.split('/').zip(known).any(|(number, known)| is_lost(number, known));
                if words.any(is_lost) {
                    return Some(place + 1);
                }
            }
            _ => {}
        }
    }
    None
}

fn is_lost(number: &str, known: u64) -> bool {
    match number.strip_prefix('-') {
        Some(back) => back.parse::<u64>().is_ok_and(|back| back > known),
        // Ten digits are the most that matter.
        None => number.len() > 9 && number.parse::<u64>().is_ok_and(|number| number > u64::from(u32::MAX)),
    }
}

/// Reads a text and tells how far it is.
pub struct Lines<'a> {
    rest: &'a [u8],
    length: usize,
    line: usize,
    progress: &'a super::super::Progress,
}

impl<'a> Lines<'a> {
    pub fn new(text: &'a str, progress: &'a super::super::Progress) -> Self {
        Lines { rest: text.as_bytes(), length: text.len().max(1), line: 0, progress }
    }

    /// The line that was read last, from 1.
    pub fn line(&self) -> usize {
        self.line
    }
}

impl Read for Lines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.rest.read(buffer)
    }
}

impl BufRead for Lines<'_> {
    /// One line, so that they can be counted.
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        let end = self.rest.iter().position(|&byte| byte == b'\n').map_or(self.rest.len(), |at| at + 1);
        Ok(&self.rest[..end])
    }

    fn consume(&mut self, amount: usize) {
        self.rest = &self.rest[amount..];
        if amount > 0 {
            self.line += 1;
            if self.line.is_multiple_of(REPORT) {
                self.progress.tell(1.0 - self.rest.len() as f64 / self.length as f64);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn continued_lines_become_one_and_other_encodings_are_read() {
        assert_eq!(tidy(b"f 1 2 \\\n 3\nv 1".to_vec()), "f 1 2   3\nv 1");
        assert_eq!(tidy(b"usemtl Stra\xDFe\n".to_vec()), "usemtl Stra\u{DF}e\n");
    }

    #[test]
    fn corners_that_no_vertex_can_be_are_found() {
        let vertices = "v 0 0 0\nv 1 0 0\nvt 0 0\n";
        for good in
            ["f 1 2 3", "f -1 -2 99", "f 1/-1 2//7 3", "l 1 -2", "f 4294967295 1 1", "#f -9", "f x -y"]
        {
            assert_eq!(lost_corner(&format!("{vertices}{good}")), None, "{good}");
        }
        for lost in ["f 1 2 -3", "f 1/-2 2 2", "  f 1 1//-1 2", "l -3 1", "f 4294967296 1 1"] {
            assert_eq!(lost_corner(&format!("{vertices}{lost}\nv 0 0 0")), Some(4), "{lost}");
        }
    }

    #[test]
    fn triangles_are_counted_by_corners() {
        assert_eq!(
            triangles("v 0 0 0\nf 1 2 3\n  f 1/1 2/2 3/3 4/4\nf\t1 2 3 4 5\nf 1 2\n#f 1 2 3\nfoo 1 2 3"),
            6
        );
    }
}
