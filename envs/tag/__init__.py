"""The task `tag`: pursuers capture an evader that is a robot too, and plays against them."""
