"""Colours of the lines in figures of the loop, the estimators and the paper."""

BLUE, ORANGE, GREEN, VIOLET, GREY = '#1f5fa8', '#d1622b', '#2e8b57', '#7b4fa3', '#707070'
