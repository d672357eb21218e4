"""The former name of `preconditioner`, until `bundle` imports the new one."""

from scenectl.generators.mscot.networks.preconditioner import Preconditioner as Metric

__all__ = ["Metric"]
