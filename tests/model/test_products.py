"""Products by other kernels are the products, with their gradients."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from posecast.model import products
from posecast.model.products import Weight, linear, linear_columns


def _columns(rows: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    return linear_columns(rows, weight, bias).t()


@pytest.fixture(params=[True, False], ids=["own kernel", "as PyTorch chooses"])
def kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Either way, whatever this processor would choose."""
    monkeypatch.setattr(products, "_is_quicker", lambda weight: request.param)


@pytest.mark.usefixtures("kernel")
@pytest.mark.parametrize("product", [linear, _columns])
@pytest.mark.parametrize("count", [1, 7, 300])
def test_a_product_and_its_gradients_are_those_of_a_linear_layer(
    product: Callable[..., Tensor], count: int, generator: torch.Generator
) -> None:
    shapes = ((count, 37), (24, 37), (24,), (count, 24))
    *factors, pull = (torch.randn(*shape, generator=generator) for shape in shapes)
    exact = [factor.double().requires_grad_() for factor in factors]
    expected = torch.nn.functional.linear(*exact)
    expected.backward(pull.double())
    given = [factor.requires_grad_() for factor in factors]
    found = product(*given)
    found.backward(pull)
    torch.testing.assert_close(found.double(), expected, atol=1e-4, rtol=1e-4)
    for own, true in zip(given, exact, strict=True):
        assert own.grad is not None
        assert true.grad is not None
        torch.testing.assert_close(own.grad.double(), true.grad, atol=1e-3, rtol=1e-4)


@pytest.mark.usefixtures("kernel")
def test_axes_before_the_last_are_kept(generator: torch.Generator) -> None:
    rows = torch.randn(2, 3, 5, generator=generator)
    weight, bias = torch.randn(4, 5, generator=generator), torch.randn(4, generator=generator)
    torch.testing.assert_close(
        linear(rows, weight, bias), torch.nn.functional.linear(rows, weight, bias)
    )


def test_no_gradient_is_computed_that_nobody_asked_for(generator: torch.Generator) -> None:
    rows, bias = torch.randn(3, 5, generator=generator), torch.zeros(4)
    weight = torch.randn(4, 5, generator=generator).requires_grad_()
    linear(rows, weight, bias).sum().backward()
    assert rows.grad is None
    assert bias.grad is None
    torch.testing.assert_close(weight.grad, rows.sum(0).expand(4, 5))


@pytest.mark.parametrize("count", [2, 100, 400])
def test_a_constant_weight_multiplies_forth_and_back(
    count: int, generator: torch.Generator
) -> None:
    matrix = torch.randn(512, 520, generator=generator)
    rows, upstream = (torch.randn(count, size, generator=generator) for size in (520, 512))
    bias, onto = torch.randn(512, generator=generator), torch.ones(count, 520)
    weight = Weight(matrix)
    for _ in range(2):  # the second time with what was packed in the first
        expected = rows.double() @ matrix.double().t() + bias.double()
        torch.testing.assert_close(
            weight.product(rows, bias).double(), expected, atol=1e-3, rtol=1e-4
        )
        expected = 1 + upstream.double() @ matrix.double()
        found = weight.back(upstream, onto=onto.clone())
        torch.testing.assert_close(found.double(), expected, atol=1e-3, rtol=1e-4)


def test_the_precision_that_was_asked_for_is_set_again() -> None:
    like = torch.ones(2, 2)
    before = torch.get_float32_matmul_precision()
    with products.exact_products(like):
        pass
    assert torch.get_float32_matmul_precision() == before
    with pytest.raises(ZeroDivisionError), products.exact_products(like):
        raise ZeroDivisionError
    assert torch.get_float32_matmul_precision() == before
