//! Sequences as lines of a file, and as a section of the page.

use super::{Motion, Sequence};
use crate::metrics::temporal::BANDS;
use crate::metrics::uncovered::AGES;
use crate::tradeoff::page::escaped;

/// One line for each sequence.
pub(in crate::tradeoff) fn csv(sequences: &[Sequence]) -> String {
    let mut text = String::from(
        "name,motion,history,frames,frame_ms,rays,foveated_score,psnr_display,low_pass_flicker,flicker_0_5,\
         flicker_5_15,flicker_15_30,flicker_30,uncovered_0,uncovered_1,uncovered_2,uncovered_3,uncovered_rest,lag,\
         disagreement\n",
    );
    let cell = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.4}"));
    for s in sequences {
        let bands: Vec<String> = s.flicker_by_eccentricity.iter().map(|v| cell(*v)).collect();
        let ages: Vec<String> = s.uncovered.unwrap_or_default().iter().map(|v| cell(*v)).collect();
        text += &format!(
            "\"{}\",{},{},{},{:.3},{},{:.4},{:.3},{:.4},{},{},{},{}\n",
            s.name.replace('"', "\"\""),
            s.motion.key(),
            s.history,
            s.frames,
            s.frame_ms,
            s.rays,
            s.foveated_score,
            s.psnr_display,
            s.low_pass_flicker,
            bands.join(","),
            ages.join(","),
            cell(s.lag),
            cell(s.disagreement),
        );
    }
    text
}

/// A section of the page; empty where there is no sequence.
pub(in crate::tradeoff) fn html(sequences: &[Sequence]) -> String {
    let Some(first) = sequences.first() else { return String::new() };
    let mut text = format!(
        "<section>\n<h2>In motion</h2>\n<p>Frames that follow each other: {} of which the last {} are judged, against references \
         of what they should show. <b>Flicker</b> is the mean change of the error from frame to frame in sRGB codes of 0 to 255: after a blur of 4 pixels, \
         and by eccentricity (up to 5, 15, 30 degrees, and beyond) after a blur by what the eye resolves there. \
         <b>Uncovered</b> is the error of pixels that came into sight 0, 1, 2, 3 frames ago, and of all others: where the first are no higher than \
         the last, nothing is left of what stood before. <b>Lag</b> is in frames. The foveated score knows no time.</p>\n",
        first.history + first.frames,
        first.frames
    );
    for motion in Motion::ALL {
        let of: Vec<&Sequence> = sequences.iter().filter(|s| s.motion == motion).collect();
        if !of.is_empty() {
            text += &rows(motion, &of);
        }
    }
    text + "</section>\n"
}

fn rows(motion: Motion, sequences: &[&Sequence]) -> String {
    let mut text = format!(
        "<table class=\"motion\">\n<thead><tr><th>{}<th>frame time (ms)<th>rays<th>foveated score<th>PSNR as shown (dB)\
         <th>flicker<th colspan=\"{}\">by eccentricity<th colspan=\"{}\">uncovered<th>lag<th>binocular error</tr></thead>\n",
        motion.name(),
        BANDS.len(),
        AGES + 1
    );
    let cell = |value: Option<f64>, digits: usize| match value {
        Some(value) => format!("<td>{value:.digits$}"),
        None => "<td>".to_string(),
    };
    for s in sequences {
        let bands: String = s.flicker_by_eccentricity.iter().map(|v| cell(*v, 2)).collect();
        let ages: String = s.uncovered.unwrap_or_default().iter().map(|v| cell(*v, 1)).collect();
        text += &format!(
            "<tr><td>{}<td>{:.1}<td>{}<td>{:.2}<td>{:.2}<td>{:.2}{bands}{ages}{}{}</tr>\n",
            escaped(&s.name),
            s.frame_ms,
            s.rays,
            s.foveated_score,
            s.psnr_display,
            s.low_pass_flicker,
            cell(s.lag, 2),
            cell(s.disagreement, 4),
        );
    }
    text + "</table>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(name: &str, motion: Motion) -> Sequence {
        Sequence {
            name: name.to_string(),
            motion,
            history: 6,
            frames: 2,
            frame_ms: 10.0,
            rays: 5,
            foveated_score: 7.0,
            psnr_display: 30.0,
            low_pass_flicker: 0.25,
            flicker_by_eccentricity: [Some(0.5), None, Some(0.125), None],
            uncovered: None,
            lag: Some(1.5),
            disagreement: None,
        }
    }

    #[test]
    fn each_line_has_as_many_cells_as_the_first() {
        let text = csv(&[sequence("as given", Motion::Rest), sequence("b", Motion::Walk)]);
        let cells: Vec<usize> = text.lines().map(|line| line.split(',').count()).collect();
        assert_eq!(cells, [20; 3], "{text}");
        assert!(
            text.contains("\"as given\",rest,6,2,10.000,5,7.0000,30.000,0.2500,0.5000,,0.1250,,,,,,,1.5000,")
        );
    }

    #[test]
    fn names_are_text_and_motions_have_a_table_each() {
        let text = html(&[
            sequence("<script>", Motion::Rest),
            sequence("b", Motion::Rest),
            sequence("b", Motion::Walk),
        ]);
        assert_eq!(text.matches("<table").count(), 2);
        assert!(!text.contains("<script>"));
        assert_eq!(html(&[]), "");
    }
}
