//! Launch functions and their kernels.

use super::super::source;
use super::PARAMETERS;

/// Each declaration of a kernel in a text: name, and parameters without what says nothing of their type.
fn declared(text: &str) -> Vec<(String, Vec<(String, String)>)> {
    let parameter = |written: &str| {
        let words = written.replace('*', " * ").replace("SCENE_PARAMETERS", "SceneOf scene");
        let words: Vec<&str> =
            words.split_whitespace().filter(|word| !["__global", "const"].contains(word)).collect();
        let (name, kind) = words.split_last().unwrap();
        (name.to_string(), kind.join(" "))
    };
    let declaration = |rest: &str| {
        let (name, rest) = rest.split_once('(').unwrap();
        let (parameters, _) = rest.split_once(')').unwrap();
        (name.trim().to_string(), parameters.split(',').map(parameter).collect())
    };
    text.split("__kernel void").skip(1).map(declaration).collect()
}

/// A type of the host's as kernels write it.
fn in_opencl(given: &str) -> String {
    let given = given.replace(' ', "");
    let buffer = given.strip_prefix("Option<&Buffer<").or_else(|| given.strip_prefix("&Buffer<"));
    match (buffer.map(|element| element.trim_end_matches('>')), given.as_str()) {
        (Some("u32" | "[u32;2]"), _) => "uint *".to_string(),
        (Some("u8"), _) => "uchar *".to_string(),
        (Some("f32" | "[f32;2]" | "[f32;3]" | "[f32;4]"), _) => "float *".to_string(),
        (Some(element), _) => format!("{element} *"),
        (None, "u32") => "uint".to_string(),
        (None, "&f32") => "float".to_string(),
        (None, value) => value.trim_start_matches('&').to_string(),
    }
}

#[test]
fn launch_functions_take_what_their_kernels_do() {
    let text =
        source::text() + &source::probe_text() + &source::pattern_text() + &source::neighbours_text(4, 24);
    let declared = declared(&text);
    for (name, parameters) in PARAMETERS {
        let given: Vec<(String, String)> =
            parameters.iter().map(|(name, kind)| (name.to_string(), in_opencl(kind))).collect();
        let mut variants = declared.iter().filter(|(other, _)| other == name).peekable();
        assert!(variants.peek().is_some(), "there is no kernel {name}");
        variants.for_each(|(_, parameters)| assert_eq!(*parameters, given, "{name}"));
    }
    for (name, _) in &declared {
        assert!(PARAMETERS.iter().any(|(other, _)| other == name), "{name} has no launch function");
    }
}
