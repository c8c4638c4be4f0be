"""What logs of MR.CLAM are good for: commands beside motion, measurements beside poses, the twin.

    swarmdata fetch mrclam-6 --accept-terms
    swarmdata fetch mrclam-7 --accept-terms
    python -m tests.benchmarks.log_quality FOLDER real-robots.png

FOLDER has the files of run 7, for the places of its landmarks. Tables go to the terminal; the
figure, docs/real-robots.png, has the errors of predictions by a twin of run 6. `make bench` leaves
it out: users fetch the logs.
"""

import sys
from pathlib import Path

import numpy as np

import swarmdata
from swarmdata.drawing.line_labels import label_ends
from swarmdata.drawing.style import COLORS, GRAY, draw_grid, figure
from swarmdata.interop.logs.fitted_twin import Twin, fit_twin
from swarmdata.interop.logs.logged_drives import AS_COMMANDED, STANDING, Drives, window_sums

FITTED, HELD_OUT = "mrclam-run_6-v1", "mrclam-run_7-v1"
WINDOW = 5  # steps of 0.1 s
SECONDS = (0.5, 1.0, 2.0, 3.0, 4.0)
WIDTH, HEIGHT = 6.0, 2.1  # inches, of the figure


def correlations(drives: Drives) -> np.ndarray:
    """Of commanded and measured speed and turn rate, in steps and in half seconds, [N, 4]."""
    found = []
    for n in range(len(drives.names)):
        alone = drives.part(robots=[n])
        along = np.stack([np.cos(alone.poses[..., :-1, 2]), np.sin(alone.poses[..., :-1, 2])], -1)
        moves = np.diff(alone.poses[..., :2], axis=-2)
        measured = np.stack([(moves * along).sum(axis=-1), alone.turns], axis=-1)
        row = []
        for length in (1, WINDOW):
            whole = window_sums(alone.known.astype(float), length) > length - 0.5
            pair = [window_sums(each, length)[whole] for each in (alone.commands, measured)]
            row += [np.corrcoef(pair[0][:, k], pair[1][:, k])[0, 1] for k in range(2)]
        found.append(row)
    return np.array(found)


def measurement_errors(dataset: swarmdata.Dataset, folder: Path) -> dict[str, np.ndarray]:
    """Measured minus true ranges (m) and bearings (rad) of robots and of landmarks, [n, 2]."""
    places = np.loadtxt(folder / "Landmark_Groundtruth.dat")[:, 1:3]
    n_agents = dataset.spec.n_agents
    found: dict[str, list[np.ndarray]] = {"robots": [], "landmarks": []}
    for episode in dataset:
        poses = episode.states.reshape(-1, n_agents, 4)
        placed = np.abs(poses[..., 2:]).sum(axis=-1) > 0
        n_slots = n_agents + len(places)
        slots = episode.observations.reshape(-1, n_agents, 4, n_slots)
        fixed = np.broadcast_to(places, (len(poses), *places.shape))
        others = np.concatenate([poses[..., :2], fixed], axis=1)
        for n in range(n_agents):
            offset = others - poses[:, n, None, :2]
            heading = np.arctan2(poses[:, n, 3], poses[:, n, 2])
            bearing = np.arctan2(offset[..., 1], offset[..., 0]) - heading[:, None]
            errors = np.stack(
                [
                    slots[:, n, 2] - np.hypot(*np.moveaxis(offset, -1, 0)),
                    np.angle(np.exp(1j * (slots[:, n, 0] - bearing))),
                ],
                axis=-1,
            )
            known = (slots[:, n, 3] == 1) & placed[:, n, None]
            known[:, :n_agents] &= placed
            found["robots"].append(errors[:, :n_agents][known[:, :n_agents]])
            found["landmarks"].append(errors[:, n_agents:][known[:, n_agents:]])
    return {name: np.concatenate(each) for name, each in found.items()}


def draw(twin: Twin, drives: Drives, path: Path) -> None:
    """Mean errors of predictions after some seconds."""
    n = len(drives.names)
    predictors = {
        "no motion": [STANDING] * n,
        "as commanded": [AS_COMMANDED] * n,
        "twin": list(twin.responses.values()),
    }
    found = {
        name: [
            [part.mean() for part in drives.errors_of(each, drives.steps(after))[:2]]
            for after in SECONDS
        ]
        for name, each in predictors.items()
    }
    with figure(path, width=WIDTH, height=HEIGHT) as drawing:
        panels = drawing.subplots(1, 2)
        units = ("position", "cm", 100.0), ("heading", "°", 180 / np.pi)
        for k, (axes, (quantity, unit, scale)) in enumerate(zip(panels, units, strict=True)):
            for (name, means), color in zip(found.items(), (GRAY, *COLORS[:2]), strict=True):
                look = {"color": color, "marker": "o", "ms": 3, "lw": 1.4}
                axes.plot(SECONDS, [scale * mean[k] for mean in means], label=name, **look)
            axes.set(
                xlabel="seconds after a measured pose", ylabel=f"error of the {quantity} ({unit})"
            )
            axes.set(xlim=(0, SECONDS[-1]), ylim=(0, None))
            draw_grid(axes, "y", width=0.5)
            label_ends(axes, axes.get_lines(), HEIGHT)


def main(folder: str, picture: str) -> None:
    """Prints the tables and draws the figure."""
    fitted, held_out = swarmdata.load(FITTED), swarmdata.load(HELD_OUT)
    print("| robot | speed, 0.1 s | turn rate, 0.1 s | speed, 0.5 s | turn rate, 0.5 s |")
    for dataset in (fitted, held_out):
        drives = Drives.of(dataset)
        for name, row in zip(drives.names, correlations(drives), strict=True):
            print(f"| {dataset.recipe.id} {name} | " + " | ".join(f"{x:.2f}" for x in row) + " |")
    for name, errors in measurement_errors(held_out, Path(folder)).items():
        size = np.median(np.abs(errors), axis=0)
        middle = np.median(errors, axis=0)
        print(
            f"{name}: {len(errors):,} measurements, median error of ranges {100 * size[0]:.1f} cm "
            f"(bias {100 * middle[0]:.1f}), of bearings {np.rad2deg(size[1]):.2f} degrees "
            f"(bias {np.rad2deg(middle[1]):.2f})"
        )
    draw(fit_twin(fitted), Drives.of(held_out), Path(picture))


if __name__ == "__main__":
    main(*sys.argv[1:])
