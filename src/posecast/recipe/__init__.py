"""Recipes: the YAML of one system, checked whole and turned into its parts."""

from posecast.recipe.files import RECIPES, count_parameters, list_recipes, load_recipe
from posecast.recipe.system_recipe import CORPUS_SKELETONS, Recipe

__all__ = [
    "CORPUS_SKELETONS",
    "RECIPES",
    "Recipe",
    "count_parameters",
    "list_recipes",
    "load_recipe",
]
