//! Shot map and heat maps on the board, with the left player on the left as in the replay.

use crate::{
    board::{BoardSize, CUP_DISTANCE, CUP_RADIUS},
    recording::topic::Player,
    referee::{Event, EventKind, Frame, ScoredMatch},
    report::{Axis, Chart, Colour, Grid, Points, Series},
};
use std::f64::consts::TAU;

/// Side of a cell of a heat map (m).
const CELL: f64 = 0.02;
/// Most events in the shot map.
const SHOTS: usize = 600;
/// Length of a drawn strike in travel time of the ball (s).
const STRIKE_SECONDS: f64 = 0.05;

/// Break between the lines of one series.
const BREAK: (f64, f64) = (f64::NAN, f64::NAN);

/// Colour of a player.
fn colour(player: Player) -> Colour {
    match player {
        Player::Left => Colour::Blue,
        Player::Right => Colour::Orange,
    }
}

/// Chart coordinates of a board position: y to the right, x downwards.
fn at(position: [f64; 2]) -> (f64, f64) {
    (position[1], position[0])
}

fn on_board(title: &str, board: BoardSize) -> Chart {
    let (x, y) = (board.short_side / 2.0, board.long_side / 2.0);
    Chart::of_plane(
        title,
        Axis::new("y", "m").within(-1.02 * y, 1.02 * y),
        Axis::new("x", "m").within(-1.02 * x, 1.02 * x).reversed(),
    )
    .with_equal_axes()
    .with_height(420)
}

/// Edge of the board, centre line and goals.
fn outline(board: BoardSize) -> Vec<Series> {
    let (x, y) = (board.short_side / 2.0, board.long_side / 2.0);
    let mut edge = vec![(-y, -x), (y, -x), (y, x), (-y, x), (-y, -x)];
    edge.extend([BREAK, (0.0, -x), (0.0, x)]);
    let goal = |player: Player| {
        let middle = if player == Player::Left { -CUP_DISTANCE } else { CUP_DISTANCE };
        let circle = (0..=32).map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 32.0).sin_cos();
            (middle + CUP_RADIUS * cos, CUP_RADIUS * sin)
        });
        Series::line("", colour(player), circle.collect()).quiet()
    };
    let mut all = vec![Series::line("", Colour::Grey, edge).with_width(1.2).quiet()];
    all.extend(Player::BOTH.map(goal));
    all
}

/// Strikes as lines (thick where goal-directed), blocks as rings, goals as crosses.
pub(super) fn shot_map(matches: &[ScoredMatch], board: BoardSize) -> Chart {
    let events = matches.iter().flat_map(|scored| &scored.analysis.events);
    let shots: Vec<&Event> = events
        .filter(|event| {
            event.player.is_some()
                && matches!(event.kind, EventKind::Strike | EventKind::Block | EventKind::Goal)
        })
        .take(SHOTS)
        .collect();
    let of = |kind: EventKind, player: Player| {
        let own = move |event: &&&Event| event.kind == kind && event.player == Some(player);
        shots.iter().filter(own)
    };
    let mut series = outline(board);
    for player in Player::BOTH {
        for (directed, word, width) in [(false, "strike", 1.2), (true, "goal-directed strike", 3.0)]
        {
            let strikes = of(EventKind::Strike, player).filter(|one| one.goal_directed == directed);
            let lines: Points = strikes.flat_map(|event| strike(event)).collect();
            let name = format!("{word}, {player}");
            series.push(Series::line(&name, colour(player), lines).with_width(width));
        }
        let blocks = of(EventKind::Block, player).map(|event| at(event.position)).collect();
        series.push(Series::rings(&format!("block, {player}"), colour(player), blocks));
    }
    let goals = shots.iter().filter(|event| event.kind == EventKind::Goal);
    let goals = goals.map(|event| at(event.position)).collect();
    series.push(Series::crosses("goal", Colour::Red, goals).with_width(2.2));
    on_board("Strikes, blocks and goals", board).with_all(series)
}

/// Line of one strike, from the contact along the path of the ball.
fn strike(event: &Event) -> [(f64, f64); 3] {
    let ([x, y], [vx, vy]) = (event.position, event.velocity_out);
    [at([x, y]), at([x + STRIKE_SECONDS * vx, y + STRIKE_SECONDS * vy]), BREAK]
}

/// Time that an object spends in each cell of the board.
pub(super) fn heat(
    matches: &[ScoredMatch],
    board: BoardSize,
    title: &str,
    of: &dyn Fn(&Frame) -> Option<[f64; 2]>,
) -> Chart {
    let columns = (board.long_side / CELL).round().max(1.0) as usize;
    let rows = (board.short_side / CELL).round().max(1.0) as usize;
    let mut seconds = vec![vec![0.0_f64; columns]; rows];
    let cell = |value: f64, side: f64, count: usize| {
        let part = (value / side + 0.5) * count as f64;
        part.clamp(0.0, count as f64 - 1.0) as usize
    };
    for scored in matches {
        let analysis = &scored.analysis;
        let frame_time = analysis.duration() / analysis.track.len().max(1) as f64;
        for position in analysis.track.iter().filter_map(of) {
            let row = cell(position[0], board.short_side, rows);
            seconds[row][cell(position[1], board.long_side, columns)] += frame_time;
        }
    }
    let shade = |value: &f64| if 0.0 < *value { value.log10() } else { f64::NAN };
    let values = seconds.iter().map(|row| row.iter().map(shade).collect()).collect();
    let (x, y) = (board.short_side / 2.0, board.long_side / 2.0);
    let grid = Grid::of_numbers(values, (-y, y), (-x, x), "time (s)").of_logarithms();
    on_board(title, board).with_grid(grid).with_all(outline(board))
}
