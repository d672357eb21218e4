"""Write a goal of your own and use it in a task.

A goal is a function from a motion to a residual in natural units that is zero where it is satisfied. The decorator
registers it: task files can use it (with `--allow-code examples/02_write_a_goal.py`), `scenectl goals` lists it.

    python examples/02_write_a_goal.py
"""

import torch

import scenectl as sc


@sc.goal(unit="m", tolerance=0.02, replace=True)
def hands_apart(motion, context, *, distance: float, slack: float = 0.0):
    """Keep the wrists a distance apart, as when carrying a box.

    Args:
        distance: between the wrists, m.
        slack: how much nearer or farther is still right, m.
    """
    span = (motion.joint("left_wrist") - motion.joint("right_wrist")).norm(dim=-1, keepdim=True)
    return torch.relu((span - distance).abs() - slack)


if __name__ == "__main__":
    task = sc.Task(
        prompt="a person carries a box forward",
        seconds=4.0,
        goals=[sc.Term("hands_apart", {"distance": 0.4}, weight=100.0)],
    )
    problem = task.build()  # read, planned and checked; no model is needed for that
    print(f"{len(problem.objective.terms)} goal over {problem.seconds} s, starting at {problem.start.position}.")

    # A mistake is answered with the nearest thing that exists.
    try:
        sc.Term("hands_apart", {"distnace": 0.4})
    except sc.UserError as error:
        print(error)
