"""Data behind the report of a study: columns and their roles, rows of a page, bins, statistics, histories."""

# ruff: noqa: F403  The package offers the public names of its modules.

from percuss.jsonable import Data
from percuss.reporting.study_data.answer_sentences import *
from percuss.reporting.study_data.axis_bins import *
from percuss.reporting.study_data.carried_rows import *
from percuss.reporting.study_data.case_cells import *
from percuss.reporting.study_data.page_histories import *
from percuss.reporting.study_data.performance_profile import *
from percuss.reporting.study_data.roles import *
from percuss.reporting.study_data.value_bands import *
from percuss.reporting.study_data.values import *
