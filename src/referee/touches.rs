//! Grouping of striker impulses into touches, and their classification.

use super::{
    event::{Event, EventKind},
    impacts::Impact,
    rules::{Rules, opponent, side},
    sight::Sight,
    vector::{Vector, distance, dot, length, minus},
};
use crate::{board::CUP_RADIUS, recording::topic::Player};

/// Events of `impacts`: touches, each of one or several impulses, and wall bounces. Their episode
/// is set later.
pub(super) fn touches_and_bounces(
    impacts: &[Impact],
    sights: &[Sight],
    rules: &Rules,
) -> Vec<Event> {
    let mut events = Vec::new();
    let mut open: [Option<(Event, f64)>; 2] = [None; 2];
    for impact in impacts.iter().filter(|impact| rules.least_impulse <= impact.size()) {
        if impact.cause.is_wall() {
            events.push(event(impact, EventKind::WallBounce, None));
        }
        let Some(player) = impact.cause.striker() else { continue };
        let slot = &mut open[player as usize];
        match slot {
            Some((touch, last)) if is_same_touch(*last, impact.time, player, sights, rules) => {
                touch.velocity_out = impact.after;
                touch.confidence = touch.confidence.max(impact.confidence);
                *last = impact.time;
            }
            _ => {
                let next = (event(impact, EventKind::Touch, Some(player)), impact.time);
                events.extend(slot.replace(next).map(|(touch, _)| touch));
            }
        }
    }
    events.extend(open.into_iter().flatten().map(|(touch, _)| touch));
    for touch in events.iter_mut().filter(|event| event.kind == EventKind::Touch) {
        analyze(touch, rules);
    }
    events.sort_by(|a, b| a.time.total_cmp(&b.time));
    events
}

fn event(impact: &Impact, kind: EventKind, player: Option<Player>) -> Event {
    Event {
        time: impact.time,
        kind,
        player,
        episode: 0,
        position: impact.position,
        velocity_in: impact.before,
        velocity_out: impact.after,
        goal_directed: false,
        confidence: impact.confidence,
    }
}

/// Return whether the ball has stayed with `player`'s striker between `last` and `now`.
fn is_same_touch(last: f64, now: f64, player: Player, sights: &[Sight], rules: &Rules) -> bool {
    if now - last < rules.same_touch {
        return true;
    }
    let from = sights.partition_point(|sight| sight.time < last);
    let to = sights.partition_point(|sight| sight.time < now);
    sights[from..to].iter().all(|sight| {
        let apart = sight.ball.zip(sight.strikers[player as usize]);
        apart.is_none_or(|(a, b)| distance(a, b) < rules.touching() + rules.still_touching)
    })
}

/// Classify a touch: at most one of strike and block.
fn analyze(touch: &mut Event, rules: &Rules) {
    let Some(player) = touch.player else { return };
    let forward = [0.0, -side(player)];
    let came = dot(touch.velocity_in, forward);
    let left = dot(touch.velocity_out, forward);
    if rules.least_approach <= left && touch.speed_in() < touch.speed_out() {
        touch.kind = EventKind::Strike;
        touch.goal_directed =
            leads_over(touch.position, touch.velocity_out, rules.cup(opponent(player)));
    } else if came <= -rules.least_approach && came < left {
        touch.kind = EventKind::Block;
    }
}

/// Return whether the straight path from `position` along `velocity` passes over the cup at `cup`.
fn leads_over(position: Vector, velocity: Vector, cup: Vector) -> bool {
    let way = minus(cup, position);
    let speed = length(velocity);
    let miss = (way[0] * velocity[1] - way[1] * velocity[0]).abs() / speed.max(f64::MIN_POSITIVE);
    0.0 < dot(way, velocity) && miss < CUP_RADIUS
}
