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
    fn triangles_are_counted_by_corners() {
        assert_eq!(
            triangles("v 0 0 0\nf 1 2 3\n  f 1/1 2/2 3/3 4/4\nf\t1 2 3 4 5\nf 1 2\n#f 1 2 3\nfoo 1 2 3"),
            6
        );
    }
}
