"""Run the code of navigation.md and draw its figures beside it."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from inertiax.plots.style import COLOURS, drawing, legend_above, new_figure, to_svg


jax.config.update("jax_enable_x64", True)

HERE = Path(__file__).parent


def main() -> None:
    page = (HERE / "navigation.md").read_text(encoding="utf-8")
    made: dict = {}
    exec("\n".join(re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)), made)
    truth, minutes = made["truth"], made["step"] * np.arange(1, 1201) / 60.0
    with drawing():
        figure, (ax,) = new_figure(1, 1, height=2.8)
        for colour, name in zip(COLOURS, ("raw", "calibrated")):
            off = np.asarray(jax.vmap(made["errors"])(made[name], truth))
            ax.semilogy(minutes, np.linalg.norm(off[:, :3], axis=1), color=colour, label=name)
        ax.set(xlabel="time, min", ylabel="position error, m")
        legend_above(ax)
        budget, (left, right) = new_figure(1, 2, height=2.4, sharey=True)
        names = [s.name for s in made["rig"]]
        left.barh(names, made["metres"], color=COLOURS[0], height=0.6)
        left.set(xlabel="position after 5 min, m (1 sigma)")
        # Over decades a bar's length says nothing.
        right.plot(made["heading"], names, "o", color=COLOURS[1], ms=6)
        right.set(xlabel="heading after 5 min, ″ (1 sigma)", xscale="log")
        folder = HERE / "navigation"
        folder.mkdir(exist_ok=True)
        (folder / "position.svg").write_text(to_svg(figure) + "\n", encoding="utf-8")
        (folder / "budget.svg").write_text(to_svg(budget) + "\n", encoding="utf-8")
    print({k: np.asarray(v)[:3].round(3).tolist() for k, v in made["miss"].items()}, "m at the end")
    print(dict(zip(names, np.round(made["metres"], 4))), "m")
    print(dict(zip(names, made["heading"])), "arcsec")
    print(
        "moves found", made["solution"].parameters, "before, after", made["before"], made["after"]
    )
    print("predicted 1 sigma", jnp.asarray(made["predicted"]))


if __name__ == "__main__":
    main()
