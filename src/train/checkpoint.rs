//! A checkpoint as attachments. The learner and each policy of the pool are safetensors files;
//! counters and environments are Protocol Buffers, which preserve floating-point numbers bit for
//! bit, unlike JSON. The environments are compressed.

use super::{
    actuator::ActuatorSource,
    block::BlockState,
    pool::{Choice, Member, Opponent, PoolState, scripted_of},
    run::Checkpoint,
    settings::{OpponentMode, ScriptedWeights, TrainSettings},
};
use crate::{
    game::ActuatorQueries,
    nn::safetensors::SafetensorsError,
    ppo::{LearnerState, Policy},
};
use prost::Message;
use std::{collections::BTreeMap, io::Read};

/// Attachment with the learner.
pub(super) const LEARNER: &str = "checkpoint/learner.safetensors";
/// Attachment with the counters.
pub(super) const COUNTERS: &str = "checkpoint/counters.binpb";

/// Attachment with the environments, compressed by Zstandard.
pub(super) const BOARDS: &str = "checkpoint/boards.binpb.zst";
/// Level of that compression.
const LEVEL: i32 = 3;
/// Maximum size of decompressed environments (bytes): 100,000 environments of 1000 numbers.
const MOST_BYTES: u64 = 800_000_000;

/// Attachment with the weights of a pool member.
pub(super) fn member_attachment(name: &str) -> String {
    format!("pool/{name}.safetensors")
}

#[derive(Clone, PartialEq, Message)]
struct Counters {
    #[prost(message, repeated, tag = "1")]
    members: Vec<MemberCounters>,
    /// Scores of the window plus one, oldest first.
    #[prost(bytes = "vec", tag = "2")]
    window: Vec<u8>,
    #[prost(double, tag = "3")]
    rating: f64,
    #[prost(uint64, tag = "4")]
    queries: u64,
    #[prost(uint64, tag = "5")]
    extrapolated_queries: u64,
    #[prost(uint64, tag = "6")]
    updates: u64,
}

#[derive(Clone, PartialEq, Message)]
struct MemberCounters {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(uint64, tag = "2")]
    update: u64,
    #[prost(double, tag = "3")]
    rating: f64,
    #[prost(bool, tag = "4")]
    draws: bool,
}

#[derive(Clone, PartialEq, Message)]
struct Boards {
    #[prost(message, repeated, tag = "1")]
    blocks: Vec<BlockState>,
}

impl Boards {
    fn to_bytes(&self) -> Vec<u8> {
        zstd::encode_all(self.encode_to_vec().as_slice(), LEVEL)
            .expect("writing to memory cannot fail")
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let mut plain = Vec::new();
        zstd::Decoder::new(bytes)
            .and_then(|decoder| decoder.take(MOST_BYTES).read_to_end(&mut plain))
            .map_err(|error| error.to_string())?;
        Self::decode(plain.as_slice()).map_err(|error| error.to_string())
    }
}

/// Reason of a rejected checkpoint: the attachment and the fault.
pub(super) type Refusal = (String, String);

impl Checkpoint {
    /// Attachments of the checkpoint by name.
    pub(super) fn to_attachments(&self) -> Vec<(String, Vec<u8>)> {
        let none = BTreeMap::new();
        let counters = Counters {
            members: self.pool.members.iter().map(MemberCounters::of).collect(),
            window: self.pool.window.iter().map(|score| (score + 1) as u8).collect(),
            rating: self.pool.rating,
            queries: self.queries.total,
            extrapolated_queries: self.queries.extrapolated,
            updates: self.curve.len() as u64,
        };
        let mut attachments = vec![
            (LEARNER.to_owned(), self.learner.to_safetensors(&none)),
            (COUNTERS.to_owned(), counters.encode_to_vec()),
            (BOARDS.to_owned(), Boards { blocks: self.boards.clone() }.to_bytes()),
        ];
        for (member, opponent) in self.pool.members.iter().zip(&self.opponents) {
            if let Opponent::Policy(policy, _) = opponent {
                attachments.push((member_attachment(&member.name), policy.to_safetensors(&none)));
            }
        }
        attachments
    }

    /// Inverse of [`to_attachments`](Self::to_attachments); `curve` is that of the whole run. Rigs are not saved.
    pub(super) fn from_attachments(
        settings: &TrainSettings,
        actuator: &ActuatorSource,
        curve: &[super::CurvePoint],
        find: &dyn Fn(&str) -> Option<Vec<u8>>,
    ) -> Result<Self, Refusal> {
        let bytes = |name: &str| {
            find(name).ok_or_else(|| (name.to_owned(), "the attachment is missing".to_owned()))
        };
        let refusal = |name: &str, error: SafetensorsError| (name.to_owned(), error.to_string());
        let (learner, _) = LearnerState::from_safetensors(&bytes(LEARNER)?)
            .map_err(|error| refusal(LEARNER, error))?;
        let counters = Counters::decode(bytes(COUNTERS)?.as_slice())
            .map_err(|error| (COUNTERS.to_owned(), error.to_string()))?;
        let updates = counters.updates as usize;
        if curve.len() < updates || learner.updates != counters.updates {
            let reason = format!(
                "it counts {updates} updates, but the learner {} and the curve {}",
                learner.updates,
                curve.len()
            );
            return Err((COUNTERS.to_owned(), reason));
        }
        if counters.members.is_empty() || counters.window.iter().any(|score| 2 < *score) {
            return Err((COUNTERS.to_owned(), "the pool is empty or has no results".to_owned()));
        }
        let boards = Boards::from_bytes(&bytes(BOARDS)?)
            .map_err(|reason| (BOARDS.to_owned(), reason))?
            .blocks;
        let members = counters.members.len() as u32;
        check_opponents(&boards, members, settings.opponents.scripted_weights)?;
        if boards.is_empty() != (updates == 0 || actuator.is_rig()) {
            let reason = format!("{} blocks of environments after {updates} updates", boards.len());
            return Err((BOARDS.to_owned(), reason));
        }
        let mut opponents = Vec::new();
        for member in &counters.members {
            opponents.push(match settings.opponents.mode {
                OpponentMode::Scripted(script) => Opponent::Scripted(script),
                _ => {
                    let name = member_attachment(&member.name);
                    let (policy, _) = Policy::from_safetensors(&bytes(&name)?)
                        .map_err(|error| refusal(&name, error))?;
                    Opponent::Policy(Box::new(policy), member.choice())
                }
            });
        }
        Ok(Self {
            learner,
            pool: PoolState {
                members: counters.members.iter().map(MemberCounters::member).collect(),
                window: counters.window.iter().map(|score| *score as i8 - 1).collect(),
                rating: counters.rating,
            },
            opponents,
            queries: ActuatorQueries {
                total: counters.queries,
                extrapolated: counters.extrapolated_queries,
            },
            curve: curve[..updates].to_vec(),
            boards,
        })
    }
}

/// Check that every environment has an opponent of a pool of `members`, or a scripted one.
fn check_opponents(
    boards: &[BlockState],
    members: u32,
    weights: ScriptedWeights,
) -> Result<(), Refusal> {
    let is_outside =
        |opponent: &u32| members <= *opponent && scripted_of(*opponent, weights).is_none();
    if !boards.iter().flat_map(|own| &own.drawn).any(is_outside) {
        return Ok(());
    }
    let reason = format!("an environment has an opponent outside the pool of {members} members");
    Err((BOARDS.to_owned(), reason))
}

impl MemberCounters {
    fn of(member: &Member) -> Self {
        let Member { name, update, rating, choice } = member.clone();
        Self { name, update, rating, draws: choice == Choice::Random }
    }

    fn choice(&self) -> Choice {
        if self.draws { Choice::Random } else { Choice::Mean }
    }

    fn member(&self) -> Member {
        let Self { name, update, rating, .. } = self.clone();
        Member { name, update, rating, choice: self.choice() }
    }
}
