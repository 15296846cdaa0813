"""Reads results of a workspace from a server: ``python notebook.py URL``."""

import sys

import numpy as np

from fusion.client import connect

with connect(sys.argv[1]) as session:
    scale = session.result("ball", "scale")
    epsilon, sigma = (100.0 * scale[key] for key in ("epsilon", "epsilon_sigma"))
    print(f"all lengths have to be multiplied by 1 + ε, ε = {epsilon:.4f} ± {sigma:.4f} %")
    for row in scale["per_pair"][:3]:
        print(
            row["image"],
            f"{100.0 * row['epsilon']:.4f} %",
            "used" if row["used"] else row["reason"],
        )

    # A fused maplet: heights with their sigma, unknown ones are NaN.
    name = session.items("ball", "fused")[0]["name"]
    fused = session.dataset("ball", "fused", name, ["height", "sigma", "difference"])
    print(fused)
    print(f"median sigma of {name}: {100.0 * float(np.nanmedian(fused['sigma'])):.1f} cm")

    # A job, as from the command line; everything is up to date here.
    job = session.wait(session.submit("ball", ["scale"]), progress=False)
    print(job.state, job.result["stages"][0]["state"])
