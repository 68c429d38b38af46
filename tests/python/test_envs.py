"""The environments: interfaces of Gymnasium and PettingZoo, determinism, rules, shared memory."""

import numpy as np
import pytest

from klasktron import KlasktronError, Policy

gymnasium = pytest.importorskip("gymnasium")
from klasktron.envs import KlaskEnv, KlaskParallelEnv, KlaskVectorEnv  # noqa: E402


def roll(envs, steps=300, seed=5):
    """Everything that random play in `envs` gives."""
    generator = np.random.default_rng(seed)
    given = [envs.reset(seed=seed)[0].copy()]
    for _ in range(steps):
        actions = generator.uniform(-1, 1, (envs.num_envs, 2)).astype(np.float32)
        *arrays, _ = envs.step(actions)
        given += [array.copy() for array in arrays]
    return given


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_gymnasium_accepts_the_environment():
    from gymnasium.utils.env_checker import check_env

    check_env(KlaskEnv(), skip_render_check=True)
    made = gymnasium.make("klasktron/Klask-v0", opponent="chaser", observations="aiming29")
    check_env(made.unwrapped, skip_render_check=True)
    assert made.observation_space.shape == (29,)
    vector = gymnasium.make_vec("klasktron/Klask-v0", num_envs=3)
    assert vector.reset(seed=0)[0].shape == (3, 12)


def test_pettingzoo_accepts_the_environment():
    test = pytest.importorskip("pettingzoo.test")
    test.parallel_api_test(KlaskParallelEnv(), num_cycles=700)
    test.parallel_seed_test(KlaskParallelEnv, num_cycles=50)


@pytest.mark.parametrize("opponent", ["random", "goalkeeper", "chaser", "shooter"])
def test_games_depend_on_the_seed_alone(opponent):
    one = roll(KlaskVectorEnv(200, opponent=opponent, threads=1))
    assert same(one, roll(KlaskVectorEnv(200, opponent=opponent, threads=3)))
    assert same(one, roll(KlaskVectorEnv(200, opponent=opponent, copy=False)))
    assert not same(one, roll(KlaskVectorEnv(200, opponent=opponent), seed=6))


def test_a_seed_makes_later_resets_the_same():
    envs = KlaskVectorEnv(4)
    envs.reset(seed=1)
    first = [envs.reset()[0] for _ in range(3)]
    envs.reset(seed=1)
    assert same(first, [envs.reset()[0] for _ in range(3)])
    assert not np.array_equal(first[0], first[1])
    # Without any seed, as Gymnasium wants it: other games each time.
    assert not np.array_equal(KlaskVectorEnv(4).reset()[0], KlaskVectorEnv(4).reset()[0])


def test_an_episode_ends_with_its_last_observation_and_the_next_begins():
    envs = KlaskVectorEnv(64, opponent="random", time_limit_s=2.0, reward="sparse")
    envs.reset(seed=0)
    ends = {"won": 0, "lost": 0, "drawn": 0}
    generator = np.random.default_rng(0)
    age = np.zeros(64, int)
    for _ in range(1500):
        before = age.copy()
        actions = generator.uniform(-1, 1, (64, 2))
        seen, rewards, terminated, truncated, infos = envs.step(actions)
        age += 1
        ended = terminated | truncated
        assert ("final_obs" in infos) == ended.any()
        for index in np.flatnonzero(ended):
            last = infos["final_obs"][index]
            assert last.shape == (12,) and not np.array_equal(last, seen[index])
            result = infos["final_info"][index]["result"]
            assert infos["_final_obs"][index] and result == infos["result"][index]
            if result == 0:
                # The time limit, or a ball at rest for as long.
                assert truncated[index] != terminated[index] and rewards[index] == 0
                ends["drawn"] += 1
            elif result == 1:
                # Nothing for an own goal of the other player.
                assert rewards[index] in (0, 1)
                ends["won"] += 1
            else:
                assert result == -1 and rewards[index] == -1
                ends["lost"] += 1
            assert before[index] < 100
            age[index] = 0
        assert (rewards[~ended] == 0).all()
    assert all(10 < count for count in ends.values()), ends


def test_the_better_player_wins_from_either_side():
    """A simple rule for the learner against a striker at rest, from both sides."""
    for player in ("left", "right"):
        envs = KlaskVectorEnv(64, opponent="stationary", player=player, reward="sparse")
        seen, _ = envs.reset(seed=0)
        won = lost = 0
        for _ in range(1500):
            # Behind the ball, then through it: own frame, so the same rule serves both sides.
            behind = seen[:, 8:10] - np.array([0.0, 0.03])
            is_behind = np.abs(seen[:, 0] - seen[:, 8]) < 0.003
            target = np.where(is_behind[:, None], seen[:, 8:10] + [0.0, 0.05], behind)
            seen, rewards, *_ = envs.step(np.clip(25 * (target - seen[:, :2]), -1, 1))
            won += (rewards == 1).sum()
            lost += (rewards == -1).sum()
        assert 10 < won and 2 * lost < won, (player, won, lost)


def test_without_copies_two_buffers_are_filled_in_turn():
    envs = KlaskVectorEnv(8, copy=False)
    first, _ = envs.reset(seed=0)
    kept = first.copy()
    second = envs.step(np.ones((8, 2)))[0]
    assert np.array_equal(first, kept) and not np.shares_memory(first, second)
    third = envs.step(np.ones((8, 2)))[0]
    assert np.shares_memory(first, third)
    copied = KlaskVectorEnv(8)
    assert not np.shares_memory(copied.step(np.ones((8, 2)))[0], copied._own["observations"][1])


def test_actuators_change_the_motion(twin_file, actuator):
    ways = []
    for source in ("ideal", twin_file, actuator):
        envs = KlaskVectorEnv(2, actuator=source, opponent="stationary")
        start = envs.reset(seed=3)[0][:, 0]
        for _ in range(10):
            seen = envs.step(np.tile([1.0, 0.0], (2, 1)))[0]
        ways.append(seen[:, 0] - start)
    assert all((0.003 < way).all() for way in ways), ways
    assert not np.allclose(ways[0], ways[1], atol=1e-4) and not np.allclose(ways[0], ways[2], atol=1e-4)


def test_sensors_are_late_and_noisy(program, match, tmp_path):
    program("tune-ekf", match, "-o", tmp_path / "ekf", accepted=(0, 3))
    path = tmp_path / "ekf" / "ekf.json"
    exact = roll(KlaskVectorEnv(16, opponent="stationary"), 20)
    seen = roll(KlaskVectorEnv(16, opponent="stationary", sensors=path), 20)
    error = np.abs(exact[-4] - seen[-4])[:, :2]
    assert 0 < error.max() < 0.05


def test_a_policy_or_any_function_is_an_opponent(policy):
    own = Policy.load(policy)
    assert own.action_history == 3
    layout = {"observations": own.observations, "action_history": own.action_history}
    assert np.isfinite(roll(KlaskVectorEnv(16, opponent=own, **layout), 50)[-4]).all()
    rows = []
    envs = KlaskVectorEnv(16, opponent=lambda seen: rows.append(seen.copy()) or np.zeros((16, 2)))
    given = roll(envs, 50)
    assert same(given, roll(KlaskVectorEnv(16, opponent="stationary"), 50))
    # The opponent sees the board turned by 180 degrees.
    assert np.allclose(rows[0][:, 8:10], -given[0][:, 8:10])


def test_previous_commands_follow_the_state_newest_first():
    envs = KlaskVectorEnv(4, opponent="stationary", action_history=2)
    seen, _ = envs.reset(seed=0)
    assert seen.shape == (4, 16) and not seen[:, 12:].any()
    actions = np.random.default_rng(0).uniform(-1, 1, (2, 4, 2)).astype(np.float32)
    envs.step(actions[0])
    seen = envs.step(actions[1])[0]
    assert np.allclose(seen[:, 12:14], 0.4 * actions[1]) and np.allclose(seen[:, 14:], 0.4 * actions[0])
    with pytest.raises(KlasktronError, match="action_history is 9; allowed are 0 to 8"):
        KlaskVectorEnv(1, action_history=9)


def test_both_players_of_a_parallel_environment_see_the_same_game():
    env = KlaskParallelEnv(reward="sparse", time_limit_s=1.0)
    seen, _ = env.reset(seed=0)
    total = 0
    while env.agents:
        assert np.allclose(seen["left"][8:12], -seen["right"][8:12])
        seen, rewards, terminated, truncated, infos = env.step(
            {side: env.action_space(side).sample() for side in env.agents}
        )
        total += 1
    assert total <= 50 and terminated["left"] == terminated["right"]
    assert infos["left"]["result"] == -infos["right"]["result"]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"opponent": "keeper"}, "no scripted player is called 'keeper'; known are stationary"),
        ({"observations": "all"}, "observations are 'all'; known are standard12"),
        ({"reward": "big"}, "reward is 'big'; known are"),
        ({"player": "middle"}, "player is 'middle'"),
        ({"actuator": "perfect"}, "an actuator is 'ideal'"),
        ({"time_limit_s": 1e9}, "time_limit"),
        ({"num_envs": 0}, "num_envs is 0"),
    ],
)
def test_wrong_settings_are_refused(settings, sentence):
    with pytest.raises(KlasktronError, match=sentence):
        KlaskVectorEnv(**settings)


def test_wrong_actions_are_refused():
    envs = KlaskVectorEnv(4)
    envs.reset(seed=0)
    with pytest.raises(KlasktronError, match=r"actions has shape \(4, 3\).*expected are shape \(4, 2\) and dtype float32"):
        envs.step(np.zeros((4, 3)))
    with pytest.raises(KlasktronError, match="finite"):
        envs.step(np.full((4, 2), np.nan))
