"""PPO in one file, on the native batch: no library of agents, as CleanRL writes it.

`gymnasium.make_vec` makes 64 environments that one compiled call steps. The agent (proximal policy optimisation,
Schulman et al. 2017) learns on them to let a load follow a sine through the friction of a hole; its rigs are drawn anew
for every episode. The file prints the mean reward while it learns, and at the end the root mean square of the tracking
error (RMSE) of an episode on the paper's rig, where the open loop has 7.13 mm.

    python examples/ppo_native_batch.py --steps 500000       # half a minute of one core

With ``--device cuda`` the environments and the agent are on an NVIDIA GPU, and observations, actions and rewards do not
leave it; give it thousands of environments (``--envs 8192``).
"""

import argparse

import gymnasium as gym
import numpy as np
import torch
from torch import nn

import cable_envs  # noqa: F401 (registers the environments)

ENV_ID = "cable_envs/CableHole-Position-Sine-v0"
ENVS, STEPS, EPOCHS, BATCH, GAMMA, LAMBDA, CLIP, RATE = 64, 128, 5, 2048, 0.98, 0.9, 0.2, 3e-3
KEPT = 0.9  # share of the last action that is kept, so that the drive is not shaken


class Agent(nn.Module):
    def __init__(self, channels):
        super().__init__()

        def network(last):
            layers = [nn.Linear(n, m) for n, m in ((channels, 64), (64, 64), (64, 1))]
            for layer, gain in zip(layers, (2**0.5, 2**0.5, last)):
                nn.init.orthogonal_(layer.weight, gain)
                nn.init.zeros_(layer.bias)
            return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])

        self.mean, self.value, self.log_std = network(0.01), network(1.0), nn.Parameter(torch.zeros(1))

    def distribution(self, seen):
        return torch.distributions.Normal(self.mean(seen)[:, 0], self.log_std.exp())


def smoothed(last, asked):
    last = torch.as_tensor(last, device=asked.device)  # what acted last: after a reset, what holds the load
    return (KEPT * last + (1.0 - KEPT) * asked.clamp(-1.0, 1.0)).float()


@torch.no_grad()
def rollout(batch, agent, seen):
    """`STEPS` steps of every environment, with their advantages (generalised advantage estimation)."""
    rows = []
    for _ in range(STEPS):
        policy = agent.distribution(seen)
        asked = policy.sample()
        actions = smoothed(batch.unwrapped.last_actions, asked)[:, None]
        outcome = batch.step(actions if seen.is_cuda else actions.numpy())[:4]
        observation, reward, torn, late = (torch.as_tensor(part, device=seen.device) for part in outcome)
        row = (seen, asked, policy.log_prob(asked), agent.value(seen)[:, 0], reward, torn | late)
        rows.append([value.float() for value in row])
        seen = observation.clone()
    views, asked, log_prob, value, reward, end = map(torch.stack, zip(*rows))
    following = torch.cat([value[1:], agent.value(seen).T])
    delta = reward + GAMMA * (1 - end) * following - value
    advantage = torch.zeros(STEPS + 1, batch.num_envs, device=seen.device)
    for t in reversed(range(STEPS)):
        advantage[t] = delta[t] + GAMMA * LAMBDA * (1 - end[t]) * advantage[t + 1]
    data = (views, asked, log_prob, advantage[:-1], advantage[:-1] + value)
    return seen, [part.flatten(0, 1) for part in data], float(reward.mean())


def improve(agent, optimiser, data, batch=BATCH):
    """`EPOCHS` passes of clipped policy gradients over what was collected."""
    shuffled = (torch.randperm(len(data[0]), device=data[0].device) for _ in range(EPOCHS))
    for rows in (rows for order in shuffled for rows in order.split(batch)):
        seen, asked, log_prob, advantage, target = (part[rows] for part in data)
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        ratio = (agent.distribution(seen).log_prob(asked) - log_prob).exp()
        gain = torch.min(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage).mean()
        loss = 0.5 * (agent.value(seen)[:, 0] - target).square().mean() - gain
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
        optimiser.step()


def train(steps, seed, tell, device, envs):
    """An agent that has learned on so many steps of all environments together."""
    where = torch.device(device if torch.cuda.is_available() else "cpu")  # the simulator of CUDA has no torch
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    options = {"vectorization_mode": "vector_entry_point", "autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
    options |= {"sensor_noise": True, "randomize": True, "step_infos": False, "device": device}
    batch = gym.make_vec(ENV_ID, num_envs=envs, **options)
    agent = Agent(batch.single_observation_space.shape[0]).to(where)
    seen = torch.as_tensor(batch.reset(seed=seed)[0], device=where).clone()
    optimiser, updates = torch.optim.Adam(agent.parameters(), eps=1e-5), max(round(steps / (envs * STEPS)), 1)
    for k in range(updates):
        optimiser.param_groups[0]["lr"] = RATE * (1 - k / updates)
        seen, data, reward = rollout(batch, agent, seen)
        improve(agent, optimiser, data, BATCH * max(envs // ENVS, 1))
        if k % 10 == 0 or k == updates - 1:
            tell(f"{(k + 1) * envs * STEPS:8} steps   mean reward {reward:.3f}")
    return agent


def tracking_error(agent, seconds):
    """RMSE in m of one episode on the paper's rig with the agent's mean action."""
    env, errors, done, agent = gym.make(ENV_ID, sensor_noise=True, duration=seconds), [], False, agent.cpu()
    observation, _ = env.reset(seed=10_000_000)
    while not done:
        asked = agent.mean(torch.as_tensor(observation)[None])[0].detach()
        action = smoothed(env.unwrapped.simulation.buffers.named.action, asked).numpy()
        observation, _, torn, late, info = env.step(action)
        errors.append(info["error"])
        done = torn or late
    return float(np.sqrt(np.mean(np.square(errors))))


def run(steps=500_000, seed=0, seconds=20.0, tell=print, device="cpu", envs=ENVS):
    """Train an agent, then give its `tracking_error`."""
    return tracking_error(train(steps, seed, tell, device, envs), seconds)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=500_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--envs", type=int, default=ENVS)
    chosen = parser.parse_args()
    print(f"RMSE {1e3 * run(chosen.steps, chosen.seed, device=chosen.device, envs=chosen.envs):.3f} mm")
