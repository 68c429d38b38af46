//! Matches with a list of what truly happened: a small physics of its own that shares no code with the
//! referee. Steps of 0.5 ms, impacts solved within the step; a ball that rolls, walls, two strikers that
//! defend and attack, cups that keep the ball or let it out over the rim, a hand that puts it back.

use klasktron::seed::Stream;

/// Seconds of one step.
const STEP: f64 = 0.0005;
/// Reach of the ball's centre across and along (m): half of 0.32 and 0.42 less its radius.
const REACH: [f64; 2] = [0.153, 0.203];
/// Distance of the centres of ball and striker when they touch (m).
const TOUCHING: f64 = 0.0145;
const CUP_DISTANCE: f64 = 0.17;
const CUP_RADIUS: f64 = 0.01905;
/// A ball that hits the cup's middle faster than this flies over it (m/s).
const CAPTURE_SPEED: f64 = 1.2;
const STRIKER_ACCELERATION: f64 = 8.0;

type Vector = [f64; 2];

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1]]
}
fn plus(a: Vector, b: Vector, times: f64) -> Vector {
    [a[0] + times * b[0], a[1] + times * b[1]]
}
fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}
fn length(a: Vector) -> f64 {
    a[0].hypot(a[1])
}

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum What {
    /// An impulse between the ball and the striker of this player (0 left, 1 right).
    Impulse(usize),
    /// An impulse at a wall.
    Wall,
    /// The ball is in the cup of this player and stays.
    Goal(usize),
    /// It went over a cup's edge and came out.
    RimOut,
    /// This player's striker went into his own cup.
    StrikerIn(usize),
    /// The ball has lain still for ten seconds.
    Timeout,
    /// The ball left the board.
    Lost,
    /// The ball is back.
    Restart,
}

/// One true event.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Truth {
    pub(crate) time: f64,
    pub(crate) what: What,
    pub(crate) place: Vector,
    pub(crate) before: Vector,
    pub(crate) after: Vector,
}

/// One picture: time, and ball, left and right striker where they were seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Picture {
    pub(crate) time: f64,
    pub(crate) ball: Option<Vector>,
    pub(crate) strikers: [Option<Vector>; 2],
}

/// How the camera sees.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    pub(crate) rate_hz: f64,
    /// Standard deviation of each coordinate (m).
    pub(crate) noise: f64,
    /// Share of frames that are lost.
    pub(crate) lost: f64,
}

pub(crate) const CAMERA: Camera = Camera { rate_hz: 120.0, noise: 0.0005, lost: 0.02 };

/// What a camera sees of a ball in a cup.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cups {
    /// The ball, until it is taken out.
    Shallow,
    /// Nothing.
    Deep,
    /// The one in every second match, the other in the rest.
    Either,
}

/// How the ball moves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Table {
    /// Restitution at walls and at strikers.
    pub(crate) bounce: [f64; 2],
    /// Friction coefficient of both.
    pub(crate) friction: f64,
    /// Coefficient of rolling resistance.
    pub(crate) rolling: f64,
    pub(crate) cups: Cups,
}

pub(crate) const TABLE: Table =
    Table { bounce: [0.8, 0.75], friction: 0.1, rolling: 0.008, cups: Cups::Either };

/// A match and what happened in it.
pub(crate) struct Game {
    pub(crate) pictures: Vec<Picture>,
    pub(crate) truths: Vec<Truth>,
}

#[derive(Clone, Copy, PartialEq)]
enum Phase {
    Play,
    /// On the rim of a player's cup, circling until the time; then it comes out.
    Rim {
        cup: usize,
        until: f64,
        phase: f64,
    },
    InCup {
        cup: usize,
        until: f64,
    },
    /// Not on the board until the time; then a serve.
    Away {
        until: f64,
    },
}

struct Striker {
    place: Vector,
    velocity: Vector,
    /// Error of aim and of place, drawn anew every so often.
    error: Vector,
    wanted: Vector,
    blunder_until: f64,
    /// When it went into its cup.
    inside_since: Option<f64>,
}

struct World {
    now: f64,
    ball: Vector,
    velocity: Vector,
    phase: Phase,
    strikers: [Striker; 2],
    truths: Vec<Truth>,
    random: Stream,
    rest_since: Option<f64>,
    next_thought: f64,
    inside_rim: bool,
    conceded: usize,
    table: Table,
}

fn cup(player: usize) -> Vector {
    [0.0, side(player) * CUP_DISTANCE]
}

/// Sign of y of a player's half.
fn side(player: usize) -> f64 {
    if player == 0 { -1.0 } else { 1.0 }
}

impl World {
    fn new(seed: u64, table: Table) -> Self {
        let striker = |player: usize| Striker {
            place: [0.0, side(player) * 0.12],
            velocity: [0.0; 2],
            error: [0.0; 2],
            wanted: [0.0; 2],
            blunder_until: 0.0,
            inside_since: None,
        };
        Self {
            now: 0.0,
            ball: [0.05, 0.02],
            velocity: [0.25, 0.35],
            phase: Phase::Play,
            strikers: [striker(0), striker(1)],
            truths: Vec::new(),
            random: Stream::new(seed, "game"),
            rest_since: None,
            next_thought: 0.0,
            inside_rim: false,
            conceded: 0,
            table,
        }
    }

    fn draw(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.random.uniform_f32(0.0, 1.0))
    }

    fn note(&mut self, time: f64, what: What, before: Vector) {
        let truth = Truth { time, what, place: self.ball, before, after: self.velocity };
        self.truths.push(truth);
    }

    fn step(&mut self) {
        if self.next_thought <= self.now {
            self.next_thought = self.now + 0.02;
            for player in 0..2 {
                self.think(player);
            }
        }
        match self.phase {
            Phase::Play => self.play(),
            Phase::Rim { cup: player, until, phase } => {
                self.move_strikers();
                self.circle(player, until, phase);
            }
            Phase::InCup { cup: player, until } => {
                self.move_strikers();
                let pull = minus(cup(player), self.ball);
                self.velocity = plus(self.velocity, pull, 900.0 * STEP);
                self.velocity = plus(self.velocity, self.velocity, -25.0 * STEP);
                self.ball = plus(self.ball, self.velocity, STEP);
                if until <= self.now {
                    self.phase = Phase::Away { until: self.now + 1.5 };
                }
            }
            Phase::Away { until } => {
                self.move_strikers();
                if until <= self.now + 1.0 {
                    self.put_strikers_back();
                }
                if until <= self.now {
                    self.serve();
                }
            }
        }
        self.now += STEP;
        self.watch_strikers();
    }

    /// A hand puts a striker that fell in back on the board.
    fn put_strikers_back(&mut self) {
        for player in 0..2 {
            let striker = &mut self.strikers[player];
            if striker.inside_since.take().is_some() {
                striker.place = [0.0, side(player) * 0.12];
                striker.velocity = [0.0; 2];
            }
        }
    }

    /// A hand rolls the ball in.
    fn serve(&mut self) {
        let s = side(self.conceded);
        let x = if self.draw(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        self.ball = [x * self.draw(0.09, 0.14), s * self.draw(0.05, 0.18)];
        let speed = self.draw(0.1, 0.5);
        let angle = self.draw(0.0, std::f64::consts::TAU);
        self.velocity = [speed * angle.cos(), speed * angle.sin()];
        self.phase = Phase::Play;
        self.rest_since = None;
        let before = [0.0; 2];
        self.note(self.now, What::Restart, before);
    }

    fn think(&mut self, player: usize) {
        let s = side(player);
        if self.draw(0.0, 1.0) < 0.06 {
            let error = [self.draw(-0.006, 0.006), self.draw(-0.03, 0.03)];
            self.strikers[player].error = error;
        }
        if self.phase == Phase::Play && self.draw(0.0, 1.0) < 0.0002 {
            self.strikers[player].blunder_until = self.now + 1.5;
        }
        let (ball, velocity) = (self.ball, self.velocity);
        let striker = &self.strikers[player];
        if striker.inside_since.is_some() {
            // It slides to the middle of the cup.
            let way = minus(cup(player), striker.place);
            self.strikers[player].wanted = [way[0] * 10.0, way[1] * 10.0];
            return;
        }
        let [miss, aim] = striker.error;
        let goal = [aim, -s * CUP_DISTANCE];
        let mine = 0.02 < s * ball[1] && self.phase == Phase::Play;
        let slow = length(velocity) < 0.35;
        let shot = minus(goal, ball);
        let shot = [shot[0] / length(shot), shot[1] / length(shot)];
        let behind = plus(ball, shot, -0.032);
        let (target, pace) = if self.now < striker.blunder_until {
            (cup(player), 0.3)
        } else if mine && slow {
            let off = minus(ball, striker.place);
            let along = dot(off, shot);
            let across = off[0] * shot[1] - off[1] * shot[0] - miss;
            if 0.0 < along && across.abs() < 0.006 && along < 0.05 {
                (plus(ball, shot, 0.03), 0.6)
            } else if along < 0.01 {
                // Around the ball, not through it.
                let beside = if off[0] < 0.0 { 0.03 } else { -0.03 };
                ([ball[0] + beside, behind[1]], 0.5)
            } else {
                (plus(behind, [1.0, 0.0], miss), 0.5)
            }
        } else {
            ([(0.55 * ball[0] + miss).clamp(-0.05, 0.05), s * 0.105], 0.6)
        };
        let target = self.off_the_cup(player, target);
        let way = minus(target, self.strikers[player].place);
        let far = length(way).max(1e-9);
        let speed = (far * 14.0).min(pace);
        self.strikers[player].wanted = [way[0] / far * speed, way[1] / far * speed];
    }

    /// Keeps a careful striker off its own cup.
    fn off_the_cup(&self, player: usize, target: Vector) -> Vector {
        if self.now < self.strikers[player].blunder_until {
            return target;
        }
        let from = minus(target, cup(player));
        let far = length(from);
        if far < 0.03 { plus(cup(player), [0.0, -side(player)], 0.03) } else { target }
    }

    fn move_strikers(&mut self) {
        let blundering = self.strikers.each_ref().map(|striker| self.now < striker.blunder_until);
        for (player, striker) in self.strikers.iter_mut().enumerate() {
            let change = minus(striker.wanted, striker.velocity);
            let most = STRIKER_ACCELERATION * STEP;
            let size = length(change);
            let share = if most < size { most / size } else { 1.0 };
            striker.velocity = plus(striker.velocity, change, share);
            striker.place = plus(striker.place, striker.velocity, STEP);
            let s = side(player);
            let bounded = [
                striker.place[0].clamp(-0.1465, 0.1465),
                s * (s * striker.place[1]).clamp(0.0235, 0.1965),
            ];
            let held = [0, 1].map(|axis: usize| bounded[axis] == striker.place[axis]);
            striker.velocity =
                [0, 1].map(|axis: usize| if held[axis] { striker.velocity[axis] } else { 0.0 });
            striker.place = bounded;
            // What is on the way around the cup slides along a circle about it.
            let off = minus(striker.place, cup(player));
            let far = length(off);
            if far < 0.026 && !blundering[player] && striker.inside_since.is_none() {
                striker.place = plus(cup(player), off, 0.026 / far);
            }
        }
    }

    fn watch_strikers(&mut self) {
        for player in 0..2 {
            let inside = length(minus(self.strikers[player].place, cup(player))) < CUP_RADIUS;
            if inside && self.strikers[player].inside_since.is_none() && self.phase == Phase::Play {
                let striker = &mut self.strikers[player];
                striker.inside_since = Some(self.now);
                striker.blunder_until = 0.0;
                self.note(self.now, What::StrikerIn(player), [0.0; 2]);
                self.conceded = player;
            }
        }
        let since = self.strikers.iter().filter_map(|s| s.inside_since).reduce(f64::min);
        if self.phase == Phase::Play && since.is_some_and(|since| since + 1.0 < self.now) {
            self.phase = Phase::Away { until: self.now + 2.0 };
        }
    }

    fn play(&mut self) {
        let starts = self.strikers.each_ref().map(|striker| striker.place);
        self.move_strikers();
        let moves: [Vector; 2] = std::array::from_fn(|player| {
            let way = minus(self.strikers[player].place, starts[player]);
            [way[0] / STEP, way[1] / STEP]
        });
        self.roll();
        let mut left = STEP;
        for _ in 0..4 {
            let Some((wait, what, normal)) = self.first_impact(starts, moves, STEP - left, left)
            else {
                break;
            };
            self.ball = plus(self.ball, self.velocity, wait);
            left -= wait;
            let before = self.velocity;
            let other = if let What::Impulse(player) = what { moves[player] } else { [0.0; 2] };
            let bounce = self.table.bounce[usize::from(what != What::Wall)];
            self.hit(normal, other, bounce);
            self.note(self.now + STEP - left, what, before);
        }
        self.ball = plus(self.ball, self.velocity, left);
        self.unstick();
        self.look_at_cups();
        self.look_at_rest();
        if 0.8 < length(self.velocity) && self.draw(0.0, 1.0) < 1e-4 {
            self.note(self.now, What::Lost, self.velocity);
            self.conceded = usize::from(self.draw(0.0, 1.0) < 0.5);
            self.phase = Phase::Away { until: self.now + 4.0 };
        }
    }

    fn roll(&mut self) {
        let speed = length(self.velocity);
        let loss = (self.table.rolling * 9.81 + 0.03 * speed) * STEP;
        let share = if speed <= loss { 0.0 } else { 1.0 - loss / speed };
        self.velocity = [self.velocity[0] * share, self.velocity[1] * share];
    }

    /// When within `left` (s) the ball first meets something, what, and the normal towards the ball.
    fn first_impact(
        &self,
        starts: [Vector; 2],
        moves: [Vector; 2],
        done: f64,
        left: f64,
    ) -> Option<(f64, What, Vector)> {
        let mut first: Option<(f64, What, Vector)> = None;
        let mut offer = |wait: f64, what: What, normal: Vector| {
            if wait <= left && first.is_none_or(|(other, ..)| wait < other) {
                first = Some((wait.max(0.0), what, normal));
            }
        };
        for axis in 0..2 {
            let v = self.velocity[axis];
            if v != 0.0 {
                let wait = (v.signum() * REACH[axis] - self.ball[axis]) / v;
                let mut normal = [0.0; 2];
                normal[axis] = -v.signum();
                offer(wait, What::Wall, normal);
            }
        }
        for player in 0..2 {
            let now = plus(starts[player], moves[player], done);
            let off = minus(self.ball, now);
            let closing = minus(self.velocity, moves[player]);
            let (a, b) = (dot(closing, closing), dot(off, closing));
            let c = dot(off, off) - TOUCHING * TOUCHING;
            if b < 0.0 && 0.0 <= b * b - a * c {
                let wait = if c <= 0.0 { 0.0 } else { (-b - (b * b - a * c).sqrt()) / a };
                let at = plus(off, closing, wait);
                let far = length(at);
                offer(wait, What::Impulse(player), [at[0] / far, at[1] / far]);
            }
        }
        first
    }

    fn hit(&mut self, normal: Vector, other: Vector, bounce: f64) {
        let closing = minus(self.velocity, other);
        let along = dot(closing, normal);
        let sliding = plus(closing, normal, -along);
        let slide = length(sliding);
        let grip = (self.table.friction * (1.0 + bounce) * along.abs()).min(2.0 / 7.0 * slide);
        self.velocity = plus(self.velocity, normal, -(1.0 + bounce) * along);
        if 0.0 < slide {
            self.velocity = plus(self.velocity, sliding, -grip / slide);
        }
    }

    /// Nothing overlaps: a ball that is pinned stops the striker.
    fn unstick(&mut self) {
        self.ball = [0, 1].map(|axis: usize| self.ball[axis].clamp(-REACH[axis], REACH[axis]));
        for player in 0..2 {
            let off = minus(self.ball, self.strikers[player].place);
            let far = length(off);
            if far < TOUCHING {
                let pushed = plus(self.strikers[player].place, off, (TOUCHING + 1e-7) / far);
                let fits = (0..2).all(|axis| pushed[axis].abs() <= REACH[axis]);
                if fits {
                    self.ball = pushed;
                } else {
                    let striker = &mut self.strikers[player];
                    striker.place = plus(self.ball, off, -(TOUCHING + 1e-7) / far);
                    striker.velocity = [0.0; 2];
                }
            }
        }
    }

    fn look_at_cups(&mut self) {
        for player in 0..2 {
            let off = minus(self.ball, cup(player));
            if CUP_RADIUS <= length(off) {
                continue;
            }
            if self.inside_rim {
                return;
            }
            self.inside_rim = true;
            let speed = length(self.velocity).max(1e-9);
            let miss = (off[0] * self.velocity[1] - off[1] * self.velocity[0]).abs() / speed;
            let before = self.velocity;
            if speed < CAPTURE_SPEED * (1.0 - (miss / CUP_RADIUS).powi(2)) {
                let far = |striker: &Striker| 0.05 < length(minus(striker.place, cup(player)));
                let free = self.strikers.iter().all(far);
                let stays = !free || 0.2 < self.draw(0.0, 1.0);
                if stays {
                    self.score(player, before);
                } else {
                    let until = self.now + self.draw(0.1, 0.35);
                    let phase = off[1].atan2(off[0]);
                    self.phase = Phase::Rim { cup: player, until, phase };
                }
            } else {
                self.velocity = plus(self.velocity, self.velocity, -0.2);
            }
            return;
        }
        if std::mem::take(&mut self.inside_rim) {
            self.note(self.now, What::RimOut, self.velocity);
        }
    }

    fn score(&mut self, player: usize, before: Vector) {
        self.note(self.now, What::Goal(player), before);
        self.conceded = player;
        self.inside_rim = false;
        let until = self.now + self.draw(1.0, 2.0);
        self.phase = Phase::InCup { cup: player, until };
    }

    /// Along the rim at 0.8 of its radius, then out.
    fn circle(&mut self, player: usize, until: f64, phase: f64) {
        let phase = phase + 0.25 / (0.8 * CUP_RADIUS) * STEP;
        let place = plus(cup(player), [phase.cos(), phase.sin()], 0.8 * CUP_RADIUS);
        let way = minus(place, self.ball);
        let share = (0.6 * STEP / length(way).max(1e-12)).min(1.0);
        self.velocity = [way[0] * share / STEP, way[1] * share / STEP];
        self.ball = plus(self.ball, way, share);
        self.phase = Phase::Rim { cup: player, until, phase };
        if until <= self.now {
            let out = minus(self.ball, cup(player));
            let far = length(out);
            // Towards the middle of the board, whatever the way in was.
            let direction = [out[0] / far * 0.5, -side(player)];
            let size = length(direction);
            self.velocity = [0.35 * direction[0] / size, 0.35 * direction[1] / size];
            self.phase = Phase::Play;
        }
    }

    fn look_at_rest(&mut self) {
        if 0.0 < length(self.velocity) {
            self.rest_since = None;
            return;
        }
        let since = *self.rest_since.get_or_insert(self.now);
        if since + 10.0 <= self.now && self.now < since + 10.0 + STEP {
            self.note(self.now, What::Timeout, [0.0; 2]);
        }
        // A hand takes it away a second later.
        if since + 11.0 <= self.now {
            self.rest_since = None;
            self.conceded = usize::from(0.0 < self.ball[1]);
            self.phase = Phase::Away { until: self.now + 2.5 };
        }
    }

    fn seen_ball(&self) -> Option<Vector> {
        match self.phase {
            Phase::Away { .. } => None,
            Phase::InCup { .. } if self.table.cups == Cups::Deep => None,
            _ => Some(self.ball),
        }
    }
}

/// Standard normal numbers by Box and Muller.
struct Noise(Stream);

impl Noise {
    fn normal(&mut self) -> f64 {
        let mut uniform = || f64::from(self.0.uniform_f32(0.0, 1.0));
        let (a, b) = (uniform().max(1e-12), uniform());
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    fn about(&mut self, place: Vector, spread: f64) -> Vector {
        [place[0] + spread * self.normal(), place[1] + spread * self.normal()]
    }
}

/// A match of `seconds` on [`TABLE`], seen by `camera`.
pub(crate) fn play(seed: u64, seconds: f64, camera: Camera) -> Game {
    play_on(TABLE, seed, seconds, camera)
}

/// A match of `seconds` on `table`, seen by `camera`.
pub(crate) fn play_on(table: Table, seed: u64, seconds: f64, camera: Camera) -> Game {
    let cups = match table.cups {
        Cups::Either if seed.is_multiple_of(2) => Cups::Shallow,
        Cups::Either => Cups::Deep,
        given => given,
    };
    let mut world = World::new(seed, Table { cups, ..table });
    let mut noise = Noise(Stream::new(seed, "camera"));
    let mut pictures = Vec::new();
    let mut shot = 0_u64;
    while world.now < seconds {
        world.step();
        let due = shot as f64 / camera.rate_hz;
        if due <= world.now {
            shot += 1;
            let ball = world.seen_ball().map(|place| noise.about(place, camera.noise));
            let strikers =
                [0, 1].map(|p: usize| Some(noise.about(world.strikers[p].place, camera.noise)));
            if camera.lost <= f64::from(noise.0.uniform_f32(0.0, 1.0)) {
                pictures.push(Picture { time: world.now, ball, strikers });
            }
        }
    }
    Game { pictures, truths: world.truths }
}
