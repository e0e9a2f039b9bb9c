//! An MTL file's statements, and the options of those that name a picture.
//!
//! tobj has a reader for these too; it gives up all materials at the first statement that it does not take,
//! and panics at a colour of one number, which MTL allows.

use std::collections::HashMap;

/// The statements of one material, by their keywords in lower case.
pub type Statements = HashMap<String, String>;

/// Names and statements of a file's materials. Lines before the first material are left out.
pub fn parse(text: &str) -> Vec<(String, Statements)> {
    let mut materials = Vec::<(String, Statements)>::new();
    for line in text.lines().map(str::trim).filter(|line| !line.starts_with('#')) {
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match keyword.to_ascii_lowercase().as_str() {
            "" => {}
            "newmtl" => materials.push((rest.trim().to_string(), Statements::new())),
            other => {
                if let Some((_, statements)) = materials.last_mut() {
                    statements.insert(other.to_string(), rest.trim().to_string());
                }
            }
        }
    }
    materials
}

/// Finite numbers at the start of a statement.
pub fn numbers(text: &str) -> Vec<f64> {
    let numbers = text.split_whitespace().map_while(|word| word.parse::<f64>().ok());
    numbers.map_while(|number| number.is_finite().then_some(number)).collect()
}

/// A colour: three numbers, or one for all three.
pub fn color(text: &str) -> Option<[f64; 3]> {
    match numbers(text)[..] {
        [r, g, b, ..] => Some([r, g, b]),
        [grey, ..] => Some([grey; 3]),
        [] => None,
    }
}

/// A picture that a statement names, with the options that matter.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// The file's name; backslashes and drive letters may be in it.
    pub file: String,
    /// `-s`: how often it is repeated along u and v.
    pub scale: [f64; 2],
    /// `-o`: how far it is moved.
    pub offset: [f64; 2],
    /// `-bm`: how high bumps are.
    pub bump: f64,
    /// `-clamp on`: it is not repeated.
    pub clamp: bool,
}

/// The picture of a statement such as `-s 2 2 1 -clamp on bark wood.png`; `None` where no name is left.
pub fn map(text: &str) -> Option<Map> {
    let mut map = Map { file: String::new(), scale: [1.0; 2], offset: [0.0; 2], bump: 1.0, clamp: false };
    let mut rest = text.trim();
    while let Some(option) = rest.strip_prefix('-') {
        let (name, after) = option.split_once(char::is_whitespace)?;
        let values = numbers(after);
        let pair = |filler: f64| [values.first(), values.get(1)].map(|v| v.copied().unwrap_or(filler));
        match name {
            "s" => map.scale = pair(1.0),
            "o" => map.offset = pair(0.0),
            "bm" => map.bump = pair(1.0)[0],
            "clamp" => map.clamp = after.trim_start().starts_with("on"),
            _ => {}
        }
        // Up to three numbers belong to these, one word to all others.
        let words = if ["s", "o", "t"].contains(&name) {
            values.len().clamp(1, 3)
        } else {
            usize::from(name == "mm") + 1
        };
        rest = after.trim_start();
        for _ in 0..words {
            rest = rest.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim_start());
        }
    }
    map.file = rest.trim_matches('"').to_string();
    (!map.file.is_empty()).then_some(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_are_kept_by_material() {
        let text = "Kd 1 1 1\nnewmtl a b\n Kd 0.5\nmap_Kd -s 2 3 wood floor.png\n#x\n\nnewmtl c\nillum\t2";
        let materials = parse(text);
        assert_eq!(materials.len(), 2);
        assert_eq!((materials[0].0.as_str(), materials[1].1["illum"].as_str()), ("a b", "2"));
        assert_eq!(color(&materials[0].1["kd"]), Some([0.5; 3]));
        assert_eq!(map(&materials[0].1["map_kd"]).unwrap().file, "wood floor.png");
    }

    #[test]
    fn options_of_pictures_are_read_or_skipped() {
        let all =
            map("-blendu on -mm 0 1 -s 2 3 1 -o 0.5 -bm 0.25 -clamp on -imfchan l \"C:\\a b.png\"").unwrap();
        let truth = Map {
            file: "C:\\a b.png".into(),
            scale: [2.0, 3.0],
            offset: [0.5, 0.0],
            bump: 0.25,
            clamp: true,
        };
        assert_eq!(all, truth);
        assert_eq!(map("-s 2 2"), None);
        assert_eq!(map("-clamp"), None);
        assert_eq!(color("spectral a.rfl"), None);
        assert_eq!(numbers("1 nan 2"), [1.0]);
    }
}
