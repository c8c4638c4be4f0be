"""The colors of a picture; red is reserved for contacts."""

Color = tuple[int, int, int]
Ink = tuple[int, int, int, int]  # a color and its opacity, 0 to 255

# fmt: off
ROBOT_COLORS: tuple[Color, ...] = (
    (0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167),
    (86, 180, 233), (120, 94, 60), (120, 24, 96), (156, 204, 156),
    (0, 84, 0), (60, 48, 144), (132, 84, 180), (108, 24, 0),
    (168, 144, 252), (144, 144, 0), (240, 168, 156), (192, 120, 84),
    (132, 132, 180), (72, 120, 0), (192, 180, 228), (156, 84, 120),
    (0, 216, 216), (72, 60, 0), (0, 108, 84), (180, 192, 60),
    (72, 132, 144), (84, 132, 228), (0, 72, 120), (120, 60, 72),
    (228, 156, 252), (72, 192, 120), (96, 180, 168), (168, 156, 108),
)
# fmt: on
"""The first six are those of Okabe and Ito, "Color Universal Design", 2008, without their reds.
Each other color is the farthest (in Oklab, at moderate chroma) from all before it, the floor, the
obstacles and the contact color."""

WHITE: Color = (255, 255, 255)
FLOOR_COLOR: Color = (252, 252, 250)
GRID_COLOR: Color = (238, 239, 238)
OBSTACLE_COLOR: Color = (84, 93, 106)
TEXT_COLOR: Color = (45, 51, 60)
CONTACT_COLOR: Color = (213, 34, 34)
UNASSIGNED_COLOR: Color = (138, 146, 157)  # targets that belong to no robot
DROPPED_COLOR: Color = (171, 112, 112)
PAYLOAD_COLOR: Color = (226, 182, 122)
PAYLOAD_EDGE_COLOR: Color = (150, 103, 47)

PURE_COLORS: tuple[Color, ...] = (
    WHITE, FLOOR_COLOR, GRID_COLOR, OBSTACLE_COLOR, TEXT_COLOR, CONTACT_COLOR, UNASSIGNED_COLOR,
    DROPPED_COLOR, PAYLOAD_COLOR, PAYLOAD_EDGE_COLOR,
)  # fmt: skip
"""All colors of a picture but those of robots."""


def robot_color(i: int) -> Color:
    """Returns the color of robot number `i`; colors repeat after 32."""
    return ROBOT_COLORS[i % len(ROBOT_COLORS)]


def tint(color: Color, strength: float) -> Color:
    """Mixes a color with that of the floor: strength 0 is the floor, 1 the color."""
    r, g, b = (round(f + strength * (c - f)) for c, f in zip(color, FLOOR_COLOR, strict=True))
    return r, g, b


def ink(color: Color, opacity: float) -> Ink:
    """Returns a translucent color; the opacity is in [0, 1]."""
    return (*color, round(255 * opacity))
