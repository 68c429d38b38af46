//! Diagram of the measured chain with every effect of the catalogue at its place, as SVG.

use super::{Block, CATALOGUE};
use crate::report::escape;
use std::fmt::Write as _;

/// Width and height of the drawing (px).
const SIZE: [i32; 2] = [1212, 812];
/// Width of a block (px).
const WIDTH: i32 = 212;
/// Distance between the left edges of two columns (px).
const PITCH: i32 = 244;
/// Left edge of the first column (px).
const LEFT: i32 = 12;
/// Height of one line of text (px).
const LINE: i32 = 18;
/// Height of the title of a block (px).
const TITLE: i32 = 28;
/// Distance of an arrow from the upper edge of the blocks that it joins (px).
const ARROW: i32 = 14;

/// Column and upper edge (px) of a block.
fn place(block: Block) -> (i32, i32) {
    match block {
        Block::Command => (0, 56),
        Block::Drive => (1, 56),
        Block::Friction => (2, 56),
        Block::Gantry => (3, 56),
        Block::Transmission => (4, 56),
        Block::Encoder => (0, 366),
        Block::Estimator => (1, 366),
        Block::Camera => (2, 366),
        Block::Coupling => (3, 366),
        Block::Geometry => (4, 366),
        Block::Ball => (3, 610),
        Block::Impact => (4, 610),
    }
}

fn names(block: Block) -> impl Iterator<Item = &'static str> {
    CATALOGUE.iter().filter(move |effect| Block::of(effect) == block).map(|effect| effect.name)
}

/// Left, top, right and bottom edge of a block (px).
fn edges(block: Block) -> [i32; 4] {
    let (column, top) = place(block);
    let left = LEFT + PITCH * column;
    let lines = names(block).count() + block.recorded().len();
    let gap = if block.recorded().is_empty() { 0 } else { 6 };
    [left, top, left + WIDTH, top + TITLE + 12 + gap + LINE * i32::try_from(lines).unwrap_or(0)]
}

/// The diagram.
///
/// ```
/// let svg = klasktron::effects::diagram();
/// assert!(svg.starts_with("<svg") && svg.contains("drive.backlash"));
/// ```
#[must_use]
pub fn diagram() -> String {
    let [width, height] = SIZE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" role=\"img\" font-family=\"system-ui, Helvetica, Arial, sans-serif\" \
         font-size=\"13\">\n<title>Measured chain from command to state estimate, with the effects of \
         the catalogue</title>\n<defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" \
         markerWidth=\"8\" markerHeight=\"8\" orient=\"auto-start-reverse\"><path d=\"M0 0L10 5L0 10z\" \
         fill=\"#44546a\"/></marker></defs>\n<rect width=\"{width}\" height=\"{height}\" \
         fill=\"#ffffff\"/>\n"
    );
    heading(&mut svg, [LEFT, 34], "Drive and gantry: from the command to the load");
    heading(
        &mut svg,
        [LEFT + PITCH, 356],
        "Striker and sensors: from the load to the state estimate",
    );
    heading(&mut svg, [LEFT + 3 * PITCH, 600], "Ball and walls");
    heading(&mut svg, [LEFT, 628], "● recorded signal");
    for arrow in arrows() {
        writeln!(
            svg,
            "<path d=\"{arrow}\" fill=\"none\" stroke=\"#44546a\" stroke-width=\"1.6\" \
             marker-end=\"url(#tip)\"/>"
        )
        .ok();
    }
    for block in Block::ALL {
        draw(&mut svg, block);
    }
    svg.push_str("</svg>\n");
    svg
}

fn heading(svg: &mut String, [left, baseline]: [i32; 2], text: &str) {
    let text = escape(text);
    writeln!(svg, "<text x=\"{left}\" y=\"{baseline}\" fill=\"#5a6474\">{text}</text>").ok();
}

fn draw(svg: &mut String, block: Block) {
    let [left, top, right, bottom] = edges(block);
    let (width, height) = (right - left, bottom - top);
    writeln!(
        svg,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" rx=\"6\" \
         fill=\"#f3f6fa\" stroke=\"#44546a\"/>\n<text x=\"{}\" y=\"{}\" font-weight=\"600\" \
         fill=\"#1b2a41\">{}</text>",
        left + 10,
        top + 20,
        escape(block.title())
    )
    .ok();
    let mut baseline = top + TITLE + 14;
    for name in names(block) {
        writeln!(
            svg,
            "<text x=\"{}\" y=\"{baseline}\" fill=\"#1f4e9c\">{}</text>",
            left + 10,
            escape(name)
        )
        .ok();
        baseline += LINE;
    }
    baseline += 6;
    for signal in block.recorded() {
        writeln!(
            svg,
            "<text x=\"{}\" y=\"{baseline}\" fill=\"#8a4b08\">● {}</text>",
            left + 10,
            escape(signal)
        )
        .ok();
        baseline += LINE;
    }
}

/// Path of each arrow between the blocks.
fn arrows() -> Vec<String> {
    let along = |from: Block, to: Block| {
        let ([left, top, right, _], [to_left, _, to_right, _]) = (edges(from), edges(to));
        let y = top + ARROW;
        if right <= to_left {
            format!("M{right} {y}L{to_left} {y}")
        } else {
            format!("M{left} {y}L{to_right} {y}")
        }
    };
    let middle = |block: Block| (edges(block)[0] + edges(block)[2]) / 2;
    let down = |from: Block, to: Block| {
        format!("M{} {}L{} {}", middle(from), edges(from)[3], middle(to), edges(to)[1])
    };
    let [friction, encoder] = [edges(Block::Friction), edges(Block::Encoder)];
    let between = friction[3] + 20;
    let camera = edges(Block::Camera);
    let ball = edges(Block::Ball);
    vec![
        along(Block::Command, Block::Drive),
        along(Block::Drive, Block::Friction),
        along(Block::Friction, Block::Gantry),
        along(Block::Gantry, Block::Transmission),
        down(Block::Transmission, Block::Geometry),
        along(Block::Geometry, Block::Coupling),
        along(Block::Coupling, Block::Camera),
        along(Block::Camera, Block::Estimator),
        format!(
            "M{x} {from}L{x} {between}L{to} {between}L{to} {end}",
            x = middle(Block::Friction),
            from = friction[3],
            to = middle(Block::Encoder),
            end = encoder[1]
        ),
        along(Block::Ball, Block::Impact),
        format!("M{} {y}L{} {y}", edges(Block::Impact)[0], ball[2], y = ball[1] + 2 * ARROW),
        format!(
            "M{} {y}L{x} {y}L{x} {}",
            ball[0],
            camera[3],
            y = ball[1] + ARROW,
            x = middle(Block::Camera)
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_has_its_place_within_the_drawing() {
        let svg = diagram();
        for effect in CATALOGUE {
            assert!(svg.contains(&format!(">{}<", effect.name)), "{}", effect.name);
        }
        for block in Block::ALL {
            let [left, top, right, bottom] = edges(block);
            assert!(0 < left && 0 < top && right < SIZE[0] && bottom < SIZE[1], "{block:?}");
            assert!(0 < names(block).count(), "{block:?}");
            for other in Block::ALL {
                let [from, upper, to, lower] = edges(other);
                let apart = right < from || to < left || bottom < upper || lower < top;
                assert!(apart || block == other, "{block:?} overlaps {other:?}");
            }
        }
    }
}
