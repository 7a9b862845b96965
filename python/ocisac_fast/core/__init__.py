"""Arrays, checks of arguments, flags and regions that all rooms share."""

from ocisac_fast.core.arrays import as_columns as as_columns
from ocisac_fast.core.flags import Flag as Flag
from ocisac_fast.core.regions import Region as Region
from ocisac_fast.core.results import Result as Result
