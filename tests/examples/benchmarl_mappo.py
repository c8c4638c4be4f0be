"""Trains BenchMARL's MAPPO on a world of this library and scores it on the reserved episodes.

    python tests/examples/benchmarl_mappo.py FOLDER [PRESET]
    python tests/examples/benchmarl_mappo.py --speed

The first writes BenchMARL's files to FOLDER and prints the success rate; the second prints how many
joint steps TorchRL collects in a CPU second from `swarmdata.make_torchrl_env`, and from one
PettingZoo environment. It needs BenchMARL 1.5, which runs on TorchRL 0.11.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.environments.common import TaskClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from tensordict import TensorDict
from torchrl.data import Composite
from torchrl.envs import EnvBase, PettingZooWrapper
from torchrl.envs.utils import ExplorationType, set_exploration_type

import swarmdata

GROUP = "agents"
COPIES = 64


class SwarmdataTask(TaskClass):
    """A preset of this library as a task of BenchMARL; copies are stepped together."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        spec = swarmdata.preset(self.name)
        return lambda: swarmdata.make_torchrl_env(spec, num_envs, seed=seed)

    def supports_continuous_actions(self) -> bool:
        return True

    def supports_discrete_actions(self) -> bool:
        return False

    def has_render(self, env: EnvBase) -> bool:
        return False

    def max_steps(self, env: EnvBase) -> int:
        return swarmdata.preset(self.name).horizon

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        return {GROUP: list(swarmdata.preset(self.name).agent_names)}

    def observation_spec(self, env: EnvBase) -> Any:
        robots = env.full_observation_spec_unbatched[GROUP].clone()
        seen = Composite({"observation": robots["observation"]}, shape=robots.shape)
        return Composite({GROUP: seen})

    def info_spec(self, env: EnvBase) -> None:
        return None

    def state_spec(self, env: EnvBase) -> Any:
        return Composite({"state": env.full_observation_spec_unbatched["state"].clone()})

    def action_spec(self, env: EnvBase) -> Any:
        return env.full_action_spec_unbatched

    def action_mask_spec(self, env: EnvBase) -> None:
        return None

    @staticmethod
    def env_name() -> str:
        return "swarmdata"

    @staticmethod
    def log_info(batch: Any) -> dict[str, float]:
        """The rate of success among the episodes that ended in a batch."""
        ended, solved = batch["next", "done"].sum(), batch["next", "success"].sum()
        return {"success": float(solved / ended)} if ended else {}


def train(folder: Path, preset: str = "coop_nav", n_iterations: int = 100) -> Experiment:
    """Trains with BenchMARL's settings of MAPPO, but more copies and a larger learning rate."""
    config = ExperimentConfig.get_from_yaml()
    config.on_policy_n_envs_per_worker = COPIES
    config.on_policy_collected_frames_per_batch = 100 * COPIES
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 10, 1600
    config.max_n_frames, config.max_n_iters = None, n_iterations
    config.lr, config.gamma = 5e-4, 0.95
    config.evaluation, config.render, config.loggers = False, False, ["csv"]
    config.save_folder = str(folder)
    folder.mkdir(parents=True, exist_ok=True)
    experiment = Experiment(
        task=SwarmdataTask(preset, {}),
        algorithm_config=MappoConfig.get_from_yaml(),
        model_config=MlpConfig.get_from_yaml(),
        critic_model_config=MlpConfig.get_from_yaml(),
        seed=0,
        config=config,
    )
    experiment.run()
    return experiment


def score(experiment: Experiment, preset: str, n_episodes: int = 1000) -> swarmdata.EvalResult:
    """Plays the greedy policy on the episodes that every policy of this library is scored on."""
    policy = experiment.policy

    def act(observations: Any) -> Any:
        rows = TensorDict({"observation": torch.from_numpy(observations)}, observations.shape[:2])
        seen = TensorDict({GROUP: rows}, observations.shape[:1])
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            return policy(seen)[GROUP, "action"]

    spec = swarmdata.preset(preset)
    actor = swarmdata.FunctionPolicy(act)
    return swarmdata.evaluate(actor, spec, name="BenchMARL MAPPO", n_episodes=n_episodes)


def frames_per_second(env: EnvBase, n_steps: int = 200) -> float:
    """Joint steps of all copies in a CPU second, of random actions, after a warm-up."""
    torch.set_num_threads(1)
    env.rollout(10, break_when_any_done=False)
    start = time.process_time()
    env.rollout(n_steps, break_when_any_done=False)
    return n_steps * max(1, env.batch_size.numel()) / (time.process_time() - start)


def compare_speed() -> dict[str, float]:
    """Joint steps a second of both ways into TorchRL."""
    spec = swarmdata.preset("coop_nav")
    group_map = {GROUP: list(spec.agent_names)}
    speeds = {
        f"make_torchrl_env, {n} copies": frames_per_second(swarmdata.make_torchrl_env(spec, n))
        for n in (1, COPIES, 16 * COPIES)
    }
    env = PettingZooWrapper(swarmdata.make_env(spec, api="pettingzoo"), group_map=group_map)
    return {**speeds, "PettingZooWrapper": frames_per_second(env)}


def main(folder: Path, preset: str = "coop_nav", n_iterations: int = 100) -> float:
    """Trains, scores and prints the rate of success."""
    result = score(train(folder, preset, n_iterations), preset)
    success = float(result.metrics["success"].mean())
    print(f"success in {len(result.seeds):,} reserved episodes: {success:.1%}")
    return success


if __name__ == "__main__":
    if sys.argv[1] == "--speed":
        for name, speed in compare_speed().items():
            print(f"{name:30} {speed:10,.0f} joint steps per CPU second")
    else:
        main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "coop_nav")
