"""What tiers and tasks mean, in words: the one place for text that cards show by tier and task."""

from types import MappingProxyType

TIER_DESCRIPTIONS = MappingProxyType(
    {
        "random": (
            "Commands are drawn uniformly and independently, for each robot and step. Robots "
            "tremble around where they start: states far from starts are rare, success is almost "
            "never seen. A floor: what an algorithm gains over this set it gained from the reward."
        ),
        "scripted": (
            "Made by a controller such as a robotics engineer would write, without learning and "
            "mostly without noise; its name is in the table below. It may read the state, so what "
            "it does need not follow from what robots observe. Nearly deterministic: actions cover "
            "little of what could be done in a state."
        ),
        "medium": (
            "Several independently trained policies, each the first checkpoint of its training "
            "whose team success on selection episodes lay between 40 % and 60 %, with Gaussian "
            "action noise. About half the episodes fail, so choosing among the actions pays off. "
            "The policies were trained apart and coordinate each in its own way."
        ),
        "medium-replay": (
            "The policies that training met on its way to medium, from the untrained one on, in "
            "the proportion in which training met them. The widest mixture: most episodes are "
            "poor, a few are good, and conventions change in the course of training."
        ),
        "medium-expert": (
            "Half of the joint steps by the policies of medium, half by those of expert. Returns "
            "have two modes; an algorithm that copies everything lands between them."
        ),
        "expert": (
            "Several independently trained policies at the end of their training, on "
            "return at least as good as the scripted controller, with Gaussian action noise. "
            "Failures are rare: what not to do is hardly in the data."
        ),
        "mixed-conventions": (
            "Experts with passing conventions that do not go together: half were trained to keep "
            "to the right of oncoming robots, half to the left, and all robots of a team keep to "
            "the same side. Nearly every episode is good, but robots that each copy the mixture "
            "on their own pick sides independently and meet in the middle. The table of passings "
            "shows how strong the conventions are."
        ),
        "narrow": (
            "One expert with little action noise: high returns and poor coverage. Values of other "
            "actions cannot be learned from it, which tests how much an algorithm trusts what it "
            "has not seen."
        ),
    }
)
"""Tier -> what its data are; shares and noise of this very set are in the table of policies."""

UNKNOWN_TIER_DESCRIPTION = (
    "This tier is the recipe's own name for its mixture, not one of the package's: what it means "
    "is said by the policies below."
)

COMMON_LIMITS = (
    "Simulated: planar, circular robots of equal mass, no wheel slip, no sensor noise unless the "
    "observation model says so.",
    "Every episode ends for the whole team at once; no robot leaves or joins.",
    "States hold the targets; they are for training and analysis, not for deployed policies.",
    "Each episode was made by one policy only; policies are never mixed within a team.",
    "Bodies in contact overlap until the solver has pushed them apart: by about 2 mm in the "
    "median, at most by 50 mm in `warehouse` and by 17 to 33 mm in the other tasks. Robots in "
    "contact may exceed `max_speed`, by up to 15 % (`python -m tests.benchmarks.bench_contacts`).",
    "States are not quite Markov: after a step with a contact they do not tell how the solver is "
    "pushing bodies apart. A world begun in such a state is up to 4 mm away from the recorded one "
    "after the next step, where robots press a payload up to 31 mm, mostly below 0.1 mm; without "
    "contacts below 0.001 mm (the same command).",
)
"""Known limits of every dataset."""

TASK_LIMITS = MappingProxyType(
    {
        "coop_nav": (
            "Obstacles stand still; only robots get in each other's way.",
            "Robots that have arrived stay in the world as obstacles for the others.",
        ),
        "formation": (
            "Robots are told where their slots will be in a moment (`preview`); the reference "
            "waits for nobody.",
            "An episode ends as soon as the shape was held long enough, so good episodes are "
            "shorter and hold fewer of the late steps.",
        ),
        "transport": (
            "Robots push with their bodies; they can neither grip nor pull, and a payload in a "
            "corner can hardly be freed.",
            "Contacts with the payload are not in `events`; side by side contacts of robots are "
            "common while pushing and count as collisions.",
        ),
        "warehouse": (
            "Shelves and aisles are the same in every episode; a policy may know the floor by "
            "heart.",
            "Every robot is told the next corner of its own shortest way, which ignores the other "
            "robots.",
        ),
    }
)
"""Known limits by task."""

NOISE_LIMIT = (
    "Gaussian noise was added to what the policies chose and the sum clipped to [-1, 1], so that "
    "commands pile up at the bounds."
)

FEW_POLICIES_LIMIT = (
    "Few policies made many episodes, and episodes of one policy are alike: there are fewer "
    "independent examples of behavior than episodes."
)

CLONED_EXPERTS_LIMIT = (
    "Experts began as clones of the scripted controller: they resemble it, and each other more "
    "than policies that were trained from nothing would."
)

TIER_LIMITS = MappingProxyType(
    {
        "random": ("Hardly an episode is solved; do not measure imitation on it.",),
        "scripted": (
            "The controller has the state at hand; cloning it from observations alone may be "
            "impossible in part.",
        ),
        "medium": (NOISE_LIMIT, FEW_POLICIES_LIMIT),
        "medium-replay": (
            NOISE_LIMIT,
            "Checkpoints sample the training; what happened between them is not in the data.",
        ),
        "medium-expert": (NOISE_LIMIT, FEW_POLICIES_LIMIT, CLONED_EXPERTS_LIMIT),
        "expert": (NOISE_LIMIT, FEW_POLICIES_LIMIT, CLONED_EXPERTS_LIMIT),
        "mixed-conventions": (
            NOISE_LIMIT,
            CLONED_EXPERTS_LIMIT,
            "Conventions concern passing head on; in other situations the experts agree more than "
            "the tier's name says.",
        ),
        "narrow": (
            NOISE_LIMIT,
            CLONED_EXPERTS_LIMIT,
            "One policy only: results on it say little about others.",
        ),
    }
)
"""Known limits by tier."""


def limits_of(task: str, tier: str) -> tuple[str, ...]:
    """Everything that is known to limit data of a task and a tier."""
    return (*COMMON_LIMITS, *TASK_LIMITS.get(task, ()), *TIER_LIMITS.get(tier, ()))
