"""Which measurement belongs to which track."""

from maritrack.associate.marginals import joint_marginals

__all__ = ["joint_marginals"]
