"""
Heights from slopes
===================

Slopes of a surface are known everywhere, heights at a few points. The surface that agrees best with
both is the minimum of a quadratic energy (:doc:`/explanation/fusing`).
"""

# %%
# A surface of 101 × 101 points, half a metre apart, and its slopes.
import matplotlib.pyplot as plt
import numpy as np

import spcola

gsd = 0.5
generator = np.random.default_rng(1)
y, x = np.mgrid[-25:25:101j, -25:25:101j]
truth = 3 * np.exp(-((x - 5) ** 2 + y**2) / 60) + 0.5 * np.sin(x / 3) * np.cos(y / 4)
slope_x, slope_y = spcola.slopes_of(truth, gsd)

# %%
# A height step between neighbours is the mean of their slopes times the distance. Each step gets an
# error of 2 cm; weights are inverse variances.
step_sigma = 0.02
step_x, step_y = (
    step + generator.normal(0, step_sigma, step.shape)
    for step in spcola.steps_from_slopes(slope_x, slope_y, gsd)
)
step_weight = 1 / step_sigma**2

# %%
# Forty heights with a sigma of 5 cm, as a lidar would give them.
height, weight = np.full_like(truth, np.nan), np.zeros_like(truth)
rows, columns = generator.integers(0, 101, (2, 40))
height[rows, columns] = truth[rows, columns] + generator.normal(0, 0.05, 40)
weight[rows, columns] = 1 / 0.05**2

# %%
# The solution, and the sigma of each height.
problem = spcola.HeightProblem(
    step_x,
    step_y,
    weight_x=np.full_like(step_x, step_weight),
    weight_y=np.full_like(step_y, step_weight),
    height=height,
    weight=weight,
)
solution = spcola.solve_heights(problem)
sigma = spcola.posterior_sigma(problem)
error = solution.height - truth
print(solution.reason)
pull = np.sqrt(np.mean((error / sigma) ** 2))
print(f"rms error {error.std():.3f} m, rms of error / sigma {pull:.2f}")

# %%
figure, panels = plt.subplots(1, 3, figsize=(9, 3), layout="constrained")
for panel, (title, image) in zip(
    panels, {"truth, m": truth, "error, m": error, "sigma, m": sigma}.items(), strict=True
):
    figure.colorbar(panel.imshow(image), ax=panel, shrink=0.8)
    panel.set(title=title, xticks=[], yticks=[])
panels[2].plot(columns, rows, "w.", markersize=3)
plt.show()
