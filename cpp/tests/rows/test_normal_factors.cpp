#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <random>
#include <vector>

#include "rows/normal_factors.hpp"

namespace {

using Column = std::vector<double>;

double product(const Column& a, const Column& b) {
  double sum = 0;
  for (std::size_t n = 0; n < a.size(); ++n) sum += a[n] * b[n];
  return sum;
}

// Random columns of very different lengths.
std::vector<Column> random_columns(unsigned seed, std::size_t count) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Column> columns(count, Column(40));
  for (Column& column : columns) {
    const double length = std::pow(10.0, 3 * normal(random));
    for (double& value : column) value = length * normal(random);
  }
  return columns;
}

ocisac::NormalProducts products_of(const std::vector<Column>& columns, const Column& explained) {
  ocisac::NormalProducts products;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    products.right(i) = product(columns[i], explained);
    for (std::size_t j = 0; j < columns.size(); ++j) products.normal(i, j) = product(columns[i], columns[j]);
  }
  return products;
}

std::size_t solvable(const std::vector<Column>& columns) {
  return ocisac::NormalFactors(products_of(columns, columns[0]), columns.size()).solvable();
}

// Leaves what the first columns do not explain of another.
Column left_of(Column explained, const std::vector<Column>& columns, const std::vector<double>& values) {
  for (std::size_t k = 0; k < values.size(); ++k)
    for (std::size_t n = 0; n < explained.size(); ++n) explained[n] -= values[k] * columns[k][n];
  return explained;
}

}  // namespace

TEST_CASE("normal factors solve all unknowns, and the first alone: what is left is orthogonal to their columns") {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const std::size_t count = 3 + seed % 15;
    const auto columns = random_columns(seed, count);
    const Column explained = random_columns(seed + 100, 1)[0];
    const ocisac::NormalFactors factors(products_of(columns, explained), count);
    REQUIRE(factors.solvable() == count);
    for (const std::size_t some : {std::size_t{1}, count - 3, count}) {
      std::vector<double> values(some);
      factors.solve(values);
      const Column left = left_of(explained, columns, values);
      for (std::size_t k = 0; k < some; ++k)
        CHECK(std::abs(product(columns[k], left)) <=
              1e-9 * std::sqrt(product(columns[k], columns[k]) * product(explained, explained)));
    }
  }
}

// (A⁻¹)_ij: the value of j where the columns explain what has the products e_i with them.
TEST_CASE("normal factors invert at the last unknowns") {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const std::size_t count = 3 + seed % 15, last = count - 3;
    const auto columns = random_columns(seed, count);
    ocisac::NormalProducts products = products_of(columns, columns[0]);
    const auto inverse = ocisac::NormalFactors(products, count).inverse_from(last);
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < count; ++k) products.right(k) = k == last + i;
      std::vector<double> values(count);
      ocisac::NormalFactors(products, count).solve(values);
      for (std::size_t j = 0; j < 3; ++j)
        CHECK(std::abs(inverse[i][j] - values[last + j]) <= 1e-9 * std::sqrt(inverse[i][i] * inverse[j][j]));
    }
  }
}

TEST_CASE("normal factors end before a column that depends on those before it, is 0 or not finite") {
  auto columns = random_columns(2, 6);
  CHECK(solvable(columns) == 6);
  for (std::size_t n = 0; n < columns[4].size(); ++n) columns[4][n] = columns[1][n] - 2 * columns[3][n];
  CHECK(solvable(columns) == 4);
  columns[3].assign(columns[3].size(), 0.0);
  CHECK(solvable(columns) == 3);
  columns[2][7] = std::numeric_limits<double>::infinity();
  CHECK(solvable(columns) == 2);
  columns[1][7] = std::numeric_limits<double>::quiet_NaN();
  CHECK(solvable(columns) == 1);
  const auto inverse = ocisac::NormalFactors(products_of(columns, columns[0]), 6).inverse_from(0);
  CHECK(inverse[0][0] == doctest::Approx(1 / product(columns[0], columns[0])));
  CHECK(inverse[1][1] == 0);
}
