"""Data behind the report of a study: columns and their roles, rows of a page, bins, statistics, histories."""

from percuss.reporting.study_data.answer_sentences import answer, value_words, winners
from percuss.reporting.study_data.axis_bins import BINS, DISTINCT, binned, binned_column, is_log, lowest, may_be_log
from percuss.reporting.study_data.carried_rows import MOST_ROWS, SEED, best_runs, carried, front
from percuss.reporting.study_data.case_cells import Cell, cells
from percuss.reporting.study_data.lost_runs import lost
from percuss.reporting.study_data.page_histories import (
    MOST_CONTACTS,
    MOST_HISTORIES,
    MOST_LETTERS,
    POINTS,
    kept_histories,
    packed,
)
from percuss.reporting.study_data.performance_profile import Problems, problems, profile
from percuss.reporting.study_data.roles import (
    ColumnRoles,
    StudyLike,
    columns,
    in_per_cent,
    is_share,
    ranking,
    references,
    words,
)
from percuss.reporting.study_data.value_bands import QUANTILES, bands, lacking
from percuss.reporting.study_data.values import STATISTICS, WAITING, as_label, in_order, methods, numbers, texts

__all__ = [
    "BINS",
    "DISTINCT",
    "MOST_CONTACTS",
    "MOST_HISTORIES",
    "MOST_LETTERS",
    "MOST_ROWS",
    "POINTS",
    "QUANTILES",
    "SEED",
    "STATISTICS",
    "WAITING",
    "Cell",
    "ColumnRoles",
    "Problems",
    "StudyLike",
    "answer",
    "as_label",
    "bands",
    "best_runs",
    "binned",
    "binned_column",
    "carried",
    "cells",
    "columns",
    "front",
    "in_order",
    "in_per_cent",
    "is_log",
    "is_share",
    "kept_histories",
    "lacking",
    "lost",
    "lowest",
    "may_be_log",
    "methods",
    "numbers",
    "packed",
    "problems",
    "profile",
    "ranking",
    "references",
    "texts",
    "value_words",
    "winners",
    "words",
]
