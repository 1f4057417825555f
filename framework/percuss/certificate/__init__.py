"""Is the closed step stable? Critical steps, their causes and cures, maps over varied values, and waves."""
