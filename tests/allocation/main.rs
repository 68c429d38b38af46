//! Steps of thousands of boards and frames of a camera allocate nothing: counted by an allocator of this process's own.
#![expect(unsafe_code, reason = "an allocator is unsafe by its trait; it only counts and hands on")]
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise")]

use klasktron::{
    actuator::{ActuatorNetwork, Layout, LayoutKind},
    camera::{
        CameraDocument, DetectingFrames, Detector, DetectorDocument, Frame, FrameSource,
        ImageFolder,
    },
    game::{
        Actuation, BiscuitSettings, EpisodeSettings, GameSettings, Games, ObservationKind,
        Outcomes, Randomization,
    },
    nn::{Dense, Network},
    recording::topic::Player,
    seed::Stream,
    twin::{Machine, Twin},
    units::Nanos,
};
use std::{
    alloc::{GlobalAlloc, Layout as Memory, System},
    cell::Cell,
};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting for each thread.
struct Counting;

fn count() {
    // A thread that is being torn down counts no more.
    let _gone = ALLOCATIONS.try_with(|allocations| allocations.set(allocations.get() + 1));
}

// SAFETY: every call is handed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, memory: Memory) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(memory) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, memory: Memory) {
        // SAFETY: the pointer came from the system's allocator.
        unsafe { System.dealloc(pointer, memory) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, memory: Memory, size: usize) -> *mut u8 {
        count();
        // SAFETY: the pointer came from the system's allocator.
        unsafe { System.realloc(pointer, memory, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(work: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.with(Cell::get);
    work();
    ALLOCATIONS.with(Cell::get) - before
}

fn network() -> ActuatorNetwork {
    let layout = Layout { kind: LayoutKind::Klasktron, history_steps: 10 };
    let mut stream = Stream::new(0, "test.network");
    let mut draw = |count| (0..count).map(|_| stream.uniform_f32(-0.1, 0.1)).collect();
    let layers = [(layout.inputs(), 16), (16, 16), (16, 2)].map(|(inputs, outputs)| Dense {
        inputs,
        outputs,
        weight: draw(inputs * outputs),
        bias: draw(outputs),
    });
    let network = Network { activation: layout.kind.activation(), layers: layers.to_vec() };
    ActuatorNetwork::new(layout, network)
}

/// Steps, restarts and observations of games with everything switched on.
fn check(actuation: Actuation) {
    const BOARDS: usize = 150;
    let name = actuation.name();
    let settings = GameSettings {
        actuation,
        episode: EpisodeSettings { time_limit: 0.3, ..EpisodeSettings::default() },
        biscuits: Some(BiscuitSettings::default()),
        randomization: Some(Randomization::paper()),
        ..GameSettings::default()
    };
    let mut games = Games::new(BOARDS, &settings, 0).unwrap();
    let mut outcomes = Outcomes::new(BOARDS);
    let kind = ObservationKind::Augmented20;
    let mut rows = vec![0.0; BOARDS * kind.len()];
    let mut stream = Stream::new(0, "test.commands");
    let mut commands = vec![[[0.0; 2]; 2]; BOARDS];
    let mut ended = 0;
    let allocated = allocations(|| {
        for _ in 0..40 {
            for value in commands.as_flattened_mut().as_flattened_mut() {
                *value = stream.uniform_f32(-0.4, 0.4);
            }
            games.step(&commands, &mut outcomes).unwrap();
            ended += outcomes.ended.iter().filter(|ended| ended.is_some()).count();
            for player in Player::BOTH {
                games.observe(player, kind, &mut rows).unwrap();
            }
        }
    });
    assert_eq!(allocated, 0, "{name}");
    assert!(2 * BOARDS <= ended, "{name}: {ended} restarts");
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(vec![1_u8; 100]))), 1);
}

#[test]
fn ideal_boards_allocate_nothing() {
    check(Actuation::Ideal);
}

#[test]
fn learned_boards_allocate_nothing() {
    check(Actuation::learned(network()));
}

#[test]
fn boards_of_a_twin_allocate_nothing() {
    check(Actuation::twin(Twin::nominal(Machine::Table)));
}

#[test]
fn frames_of_a_camera_allocate_nothing_after_the_start() {
    let data = std::path::Path::new("tests/data/camera");
    let read = |name: &str| std::fs::read_to_string(data.join(name)).unwrap();
    let camera = CameraDocument::from_json(&read("camera.json")).unwrap().camera().unwrap();
    let document = DetectorDocument::from_json(&read("detector.json")).unwrap();
    let mut frames = DetectingFrames::new(Detector::new(&camera, &document).unwrap());
    let mut source = ImageFolder::open(&data.join("table")).unwrap();
    let mut images = [Frame::default(), Frame::default()];
    for frame in &mut images {
        source.next_frame(frame).unwrap();
    }
    let mut searched = 0;
    let mut found = 0;
    let allocated = allocations(|| {
        for step in 0..40_u64 {
            // Ten frames of one scene, then ten of the other: regions, lost pieces, the whole field.
            let frame = &mut images[(step / 10 % 2) as usize];
            frame.capture_time = Nanos(step * 8_333_333);
            let seen = frames.detect(frame).unwrap();
            searched += u32::from(seen.searched_everything);
            found += u32::from(seen.ball.is_some());
        }
    });
    assert_eq!(allocated, 0);
    assert!((4..40).contains(&searched), "{searched}");
    assert_eq!(found, 40);
}
