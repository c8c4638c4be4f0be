"""Records environments whose copies play whole episodes in batches: VMAS, and those in JAX."""

from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from tqdm import tqdm

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, SpecError
from swarmdata.record.recording_folder import Limits, RecordingFolder, Session
from swarmdata.record.reset_seeds import SeedStream
from swarmdata.runtime.atomic import is_vacant
from swarmdata.specs.origins.recording_origin import Recording
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.spaces import limits_of
from swarmdata.store.parts import check_episode
from swarmdata.types import END_REASONS, Bool, Episode, Float, FloatOrByte, no_messages


def check_request(path: Path | str, policies: Sequence[str | PolicySource]) -> None:
    """Checks what can be checked before an environment is touched: the path, and one policy."""
    if not is_vacant(Path(path)):
        raise BuildError(f"{path} exists. Record to another path, or move it away.")
    if len(policies) != 1:
        raise SpecError(f"policies are {policies}, expected one: all copies play the same policy")


def record_batches(
    recording: Recording,
    path: Path | str,
    n_episodes: int,
    limits: Limits | None,
    play: Callable[[SeedStream], Sequence[Episode]],
    drawn: Callable[[set[int]], set[int]] = set,
) -> Dataset:
    """Plays batches, by seeds that `play` draws, until there are enough episodes; makes a dataset.

    A recording that was killed at `path` goes on; `drawn` gives the drawn seeds that are done, from
    the seeds of the episodes that were recorded, which are not recorded again.
    """
    folder = RecordingFolder(Path(path), limits)
    spec = recording.spec
    allowed = limits_of(spec.action_spaces)
    try:
        folder.claim(Session(recording=recording, log_probs=False, masks=False))
        recorded = folder.seeds()
        seeds = SeedStream(recording.seed, drawn(recorded))
        with tqdm(
            total=n_episodes, initial=folder.n_episodes, desc=recording.id, unit="episode",
            leave=False, disable=None,
        ) as bar:  # fmt: skip
            while (missing := n_episodes - folder.n_episodes) > 0:
                fresh = (each for each in play(seeds) if each.seed not in recorded)
                for episode in islice(fresh, missing):
                    check_episode(episode)
                    assert episode.alive is not None  # `played_episode` sets it
                    allowed.check(episode.actions, episode.alive[:-1], spec.agent_names)
                    folder.add(episode)
                    bar.update()
        return folder.finish()
    except SchemaError:
        folder.flush()
        raise
    finally:
        folder.release()


def played_episode(
    seed: int, observations: FloatOrByte, states: Float, actions: Float, rewards: Float,
    ended: Bool, *, is_cut: bool, reason: str,
) -> Episode:  # fmt: skip
    """One copy's episode; what agents observe and do after they have left becomes zero.

    Of T steps come observations [T + 1, N, O], states [T + 1, S], actions [T, N, A], rewards and
    who has ended, [T, N] each; in the last step all do, truncated if `is_cut`.
    """
    T, N = ended.shape
    gone = np.logical_or.accumulate(ended, axis=0)
    gone[-1] = True
    acted = np.concatenate([np.ones((1, N), np.bool_), ~gone[:-1]])
    stops, at_end, nobody = acted & gone, np.arange(T) == T - 1, np.zeros((1, N), np.bool_)
    cut = stops & (is_cut & at_end)[:, None]
    seen = np.concatenate([acted, nobody])
    seen[1:] |= acted  # an agent also observes the state in which it stops acting
    return Episode(
        observations=np.where(seen[..., None], observations, observations.dtype.type(0)),
        states=states,
        actions=np.where(acted[..., None], actions, np.float32(0)),
        log_probs=np.zeros((T, 0), np.float32),
        rewards=np.where(acted, rewards, 0).astype(np.float32),
        terminations=at_end & (not is_cut),
        truncations=at_end & is_cut,
        events=np.zeros((T, N, 0), np.uint8),
        **no_messages(T + 1, N),
        layout=np.zeros((0, 8), np.float32),
        seed=seed,
        policy=0,
        end_reason=END_REASONS.index(reason),
        alive=np.concatenate([acted, nobody]),
        agent_terminations=stops & ~cut,
        agent_truncations=cut,
    )
