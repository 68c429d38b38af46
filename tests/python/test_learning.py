"""Other people's reinforcement learning code on these environments; skipped without torch."""

import numpy as np
import pytest

pytest.importorskip("gymnasium")
torch = pytest.importorskip("torch")

from klasktron.envs import KlaskEnv, KlaskVectorEnv  # noqa: E402


COUNT, HORIZON, GAMMA, LAMBDA = 256, 16, 0.9, 0.9
# Rewards of some 1e-3 to targets near 1; positions of some 0.1 m to inputs near 1.
REWARD_SCALE, INPUT_SCALE = 300.0, 10.0


def mlp(outputs):
    """A small network."""
    layers = [torch.nn.Linear(12, 64), torch.nn.Tanh(), torch.nn.Linear(64, outputs)]
    return torch.nn.Sequential(*layers)


def rollout(envs, seen, actor, log_std, critic):
    """Transitions of HORIZON steps, `[HORIZON][COUNT]`, and the observation after them."""
    rows = {name: [] for name in ("seen", "action", "logp", "value", "reward", "done")}
    for _ in range(HORIZON):
        policy = torch.distributions.Normal(actor(seen), log_std.exp())
        action = policy.sample()
        after, reward, terminated, truncated, _ = envs.step(action.numpy())
        own = {
            "seen": seen,
            "action": action,
            "logp": policy.log_prob(action).sum(1),
            "value": critic(seen).squeeze(1),
            "reward": torch.as_tensor(reward) * REWARD_SCALE,
            "done": torch.as_tensor(terminated | truncated),
        }
        for name, tensor in own.items():
            rows[name].append(tensor)
        seen = INPUT_SCALE * torch.as_tensor(after)
    return {name: torch.stack(tensors) for name, tensors in rows.items()}, seen


def advantages(data, following):
    """Generalized advantage estimation."""
    advantage = torch.zeros_like(data["value"])
    last = torch.zeros(COUNT)
    for step in reversed(range(HORIZON)):
        runs = (~data["done"][step]).float()
        delta = data["reward"][step] + GAMMA * following * runs - data["value"][step]
        last = delta + GAMMA * LAMBDA * runs * last
        advantage[step], following = last, data["value"][step]
    return advantage


def test_ppo_on_one_page_learns_to_approach_the_ball():
    """PPO as CleanRL writes it, for 120,000 transitions: the reward rises above that of random play."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    envs = KlaskVectorEnv(COUNT, opponent="stationary", reward="dense_ball_to_goal")
    actor, critic, log_std = mlp(2), mlp(1), torch.nn.Parameter(torch.zeros(2) - 0.5)
    parameters = [*actor.parameters(), *critic.parameters(), log_std]
    optimizer = torch.optim.Adam(parameters, lr=3e-3)
    seen = INPUT_SCALE * torch.as_tensor(envs.reset(seed=0)[0])
    rewards = []
    for _ in range(30):
        with torch.no_grad():
            data, seen = rollout(envs, seen, actor, log_std, critic)
            advantage = advantages(data, critic(seen).squeeze(1))
        data["target"], data["advantage"] = advantage + data["value"], advantage
        flat = {name: tensor.flatten(0, 1) for name, tensor in data.items()}
        for _ in range(6):
            for index in torch.randperm(COUNT * HORIZON).chunk(4):
                own = {name: tensor[index] for name, tensor in flat.items()}
                policy = torch.distributions.Normal(actor(own["seen"]), log_std.exp())
                ratio = (policy.log_prob(own["action"]).sum(1) - own["logp"]).exp()
                gain = own["advantage"]
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                loss = -torch.min(ratio * gain, ratio.clamp(0.8, 1.2) * gain).mean()
                loss = loss + 0.5 * (critic(own["seen"]).squeeze(1) - own["target"]).pow(2).mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
        rewards.append(float(data["reward"].mean()) / REWARD_SCALE)
    at_random = KlaskVectorEnv(COUNT, opponent="stationary", reward="dense_ball_to_goal")
    at_random.reset(seed=0)
    generator = np.random.default_rng(0)
    given = [at_random.step(generator.uniform(-1, 1, (COUNT, 2)))[1].mean() for _ in range(200)]
    assert np.mean(given) + 3e-4 < np.mean(rewards[-10:]), (np.mean(given), rewards)


def test_stable_baselines3_trains_in_it():
    sb3 = pytest.importorskip("stable_baselines3")
    env = KlaskEnv(opponent="stationary")
    model = sb3.PPO("MlpPolicy", env, n_steps=256, batch_size=64, n_epochs=2, seed=0, device="cpu")
    model.learn(2048)
    assert model.num_timesteps == 2048
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    assert action.shape == (2,) and np.isfinite(action).all()
