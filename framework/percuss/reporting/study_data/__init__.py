"""Data behind the report of a study: columns and their roles, rows of a page, bins, statistics, histories."""

from percuss.reporting.study_data.axis_bins import BINS, DISTINCT, binned, binned_column, is_log, lowest, may_be_log
from percuss.reporting.study_data.bands_and_maps import MAP_BINS, MAP_DISTINCT, QUANTILES, bands, lacking, maps
from percuss.reporting.study_data.carried_rows import MOST_ROWS, SEED, best_runs, carried, front
from percuss.reporting.study_data.lost_runs import lost
from percuss.reporting.study_data.overview_table import Cell, counted, largest_factor, least_medians, overview, shade
from percuss.reporting.study_data.page_histories import (
    MOST_CONTACTS,
    MOST_HISTORIES,
    MOST_LETTERS,
    POINTS,
    kept_histories,
    packed,
)
from percuss.reporting.study_data.performance_profile import Problems, problems, profile
from percuss.reporting.study_data.roles import ColumnRoles, StudyLike, columns, ranking, references, words
from percuss.reporting.study_data.values import WAITING, as_label, in_order, methods, numbers, texts

__all__ = [
    "BINS",
    "DISTINCT",
    "MAP_BINS",
    "MAP_DISTINCT",
    "MOST_CONTACTS",
    "MOST_HISTORIES",
    "MOST_LETTERS",
    "MOST_ROWS",
    "POINTS",
    "QUANTILES",
    "SEED",
    "WAITING",
    "Cell",
    "ColumnRoles",
    "Problems",
    "StudyLike",
    "as_label",
    "bands",
    "best_runs",
    "binned",
    "binned_column",
    "carried",
    "columns",
    "counted",
    "front",
    "in_order",
    "is_log",
    "kept_histories",
    "lacking",
    "largest_factor",
    "least_medians",
    "lost",
    "lowest",
    "maps",
    "may_be_log",
    "methods",
    "numbers",
    "overview",
    "packed",
    "problems",
    "profile",
    "ranking",
    "references",
    "shade",
    "texts",
    "words",
]
