//! Shot map and heat maps on a drawn board, left player on the left as in the replay.

use crate::{
    board::{BoardSize, CUP_DISTANCE, CUP_RADIUS},
    recording::topic::Player,
    referee::{Event, EventKind, Frame, ScoredMatch},
};
use std::fmt::Write as _;

/// Pixels per metre.
const SCALE: f64 = 1100.0;
/// Side of a heat map's cell (m).
const CELL: f64 = 0.02;
/// Most shots that are drawn.
const SHOTS: usize = 600;
/// An arrow is as long as the ball moves in this time (s).
const ARROW_SECONDS: f64 = 0.05;

/// Colour of a player.
pub(super) fn colour(player: Player) -> &'static str {
    match player {
        Player::Left => "#1f69b4",
        Player::Right => "#d07018",
    }
}

/// Across and down (px) of a place on the board.
fn at(board: BoardSize, place: [f64; 2]) -> (f64, f64) {
    (SCALE * (place[1] + board.long_side / 2.0), SCALE * (place[0] + board.short_side / 2.0))
}

fn drawn_board(board: BoardSize, title: &str, content: &str) -> String {
    let (width, height) = (SCALE * board.long_side, SCALE * board.short_side);
    let cups: String = Player::BOTH
        .into_iter()
        .map(|player| {
            let y = if player == Player::Left { -CUP_DISTANCE } else { CUP_DISTANCE };
            let (cx, cy) = at(board, [0.0, y]);
            format!(
                "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"{:.1}\" fill=\"none\" stroke=\"#5c6874\"/>",
                SCALE * CUP_RADIUS
            )
        })
        .collect();
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 -24 {width:.0} {:.0}\" width=\"{width:.0}\" \
         height=\"{:.0}\" role=\"img\" aria-label=\"{title}\"><text x=\"2\" y=\"-8\" \
         font-family=\"sans-serif\" font-size=\"15\">{title}</text><rect width=\"{width:.0}\" \
         height=\"{height:.0}\" fill=\"#f7f9f7\" stroke=\"#8a949f\"/><path d=\"M{:.1} 0V{height:.0}\" \
         stroke=\"#c5ccd4\"/>{content}{cups}</svg>",
        height + 26.0,
        height + 26.0,
        width / 2.0,
    )
}

/// Strikes as arrows (thick and dark when goal-directed), blocks as rings, goals as crosses.
pub(super) fn shot_map(matches: &[ScoredMatch], board: BoardSize) -> String {
    let mut content = String::new();
    let events = matches.iter().flat_map(|scored| &scored.analysis.events);
    let shots = events.filter(|event| {
        matches!(event.kind, EventKind::Strike | EventKind::Block | EventKind::Goal)
    });
    for event in shots.take(SHOTS) {
        write_shot(&mut content, event, board)
            .unwrap_or_else(|_grows| unreachable!("a String grows"));
    }
    drawn_board(board, "strikes, blocks, goals", &content)
}

fn write_shot(svg: &mut String, event: &Event, board: BoardSize) -> std::fmt::Result {
    let Some(player) = event.player else { return Ok(()) };
    let (x, y) = at(board, event.position);
    let colour = colour(player);
    match event.kind {
        EventKind::Strike => {
            let [vx, vy] = event.velocity_out;
            let tip =
                [event.position[0] + ARROW_SECONDS * vx, event.position[1] + ARROW_SECONDS * vy];
            let (to_x, to_y) = at(board, tip);
            let (width, opacity) = if event.goal_directed { (2.6, 1.0) } else { (1.2, 0.6) };
            write!(
                svg,
                "<path d=\"M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}\" stroke=\"{colour}\" \
                 stroke-width=\"{width}\" opacity=\"{opacity}\"/><circle cx=\"{x:.1}\" \
                 cy=\"{y:.1}\" r=\"2.2\" fill=\"{colour}\" opacity=\"{opacity}\"/>"
            )
        }
        EventKind::Block => write!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"none\" stroke=\"{colour}\"/>"
        ),
        _ => write!(
            svg,
            "<path d=\"M{0:.1} {1:.1}l8 8m0 -8l-8 8\" stroke=\"#b03030\" stroke-width=\"2\"/>",
            x - 4.0,
            y - 4.0
        ),
    }
}

/// Where `of` was: the darker, the longer.
pub(super) fn heat(
    matches: &[ScoredMatch],
    board: BoardSize,
    title: &str,
    of: &dyn Fn(&Frame) -> Option<[f64; 2]>,
) -> String {
    let (columns, rows) =
        ((board.long_side / CELL).ceil() as usize, (board.short_side / CELL).ceil() as usize);
    let mut counts = vec![0_u32; columns * rows];
    let frames = matches.iter().flat_map(|scored| &scored.analysis.track);
    for place in frames.filter_map(of) {
        let column = ((place[1] + board.long_side / 2.0) / CELL).clamp(0.0, columns as f64 - 1.0);
        let row = ((place[0] + board.short_side / 2.0) / CELL).clamp(0.0, rows as f64 - 1.0);
        counts[row as usize * columns + column as usize] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(0).max(1);
    let side = SCALE * CELL;
    let cells: String = counts
        .iter()
        .enumerate()
        .filter(|(_, count)| 0 < **count)
        .map(|(idx, count)| {
            // The root shows what is rare as well.
            let opacity = (f64::from(*count) / f64::from(most)).sqrt();
            format!(
                "<rect x=\"{:.0}\" y=\"{:.0}\" width=\"{side:.0}\" height=\"{side:.0}\" \
                 fill=\"#7a1f5c\" fill-opacity=\"{opacity:.2}\"/>",
                (idx % columns) as f64 * side,
                (idx / columns) as f64 * side
            )
        })
        .collect();
    drawn_board(board, title, &cells)
}
