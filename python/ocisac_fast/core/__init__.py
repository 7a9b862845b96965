"""Arrays, checks of arguments and flags that all rooms share."""

from ocisac_fast.core.arrays import as_columns as as_columns
from ocisac_fast.core.flags import Flag as Flag
