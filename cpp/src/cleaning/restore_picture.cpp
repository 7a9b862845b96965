#include "ocisac/cleaning/restore_picture.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cleaning/block_shares.hpp"
#include "core/check_interrupt.hpp"

namespace ocisac {

namespace {

constexpr std::size_t cells = 4096;  // of the table from which the search for a stored value starts
constexpr double min_left = 1e-9;    // of the light of a row, as a divisor

void check(std::size_t pixels, std::size_t columns, const StoredLight& table) {
  require(columns > 0 && pixels > 0 && pixels % columns == 0, "stored", pixels, "rows x columns values");
  require(!table.light.empty() && table.variance.size() == table.light.size(), "variance", table.variance.size(),
          "one for each stored value");
}

template <class Sample>
void check(std::span<const Sample> stored, const StoredLight& table) {
  if (table.light.size() > std::numeric_limits<Sample>::max()) return;
  const std::size_t highest = *std::ranges::max_element(stored);
  require(highest < table.light.size(), "stored", highest, "a value of the table");
}

// Stored value of linear light: that whose neighbourhood contains it.
class StoredValues {
 public:
  StoredValues(std::span<const double> light, std::span<const double> bounds)
      : bounds_(bounds), lowest_(light.front()), starts_(cells) {
    const double width = std::max(light.back() - light.front(), 1e-300) / static_cast<double>(cells);
    scale_ = 1 / width;
    for (std::size_t k = 0, value = 0; k < cells; ++k) {
      while (value < bounds.size() && lowest_ + width * static_cast<double>(k) >= bounds[value]) ++value;
      starts_[k] = static_cast<std::uint32_t>(value);
    }
  }

  std::size_t operator()(double light) const {
    const double place = std::clamp((light - lowest_) * scale_, 0.0, static_cast<double>(cells - 1));
    std::size_t value = starts_[static_cast<std::size_t>(place)];
    while (value > 0 && light < bounds_[value - 1]) --value;  // rounding of the cell's edge
    while (value < bounds_.size() && light >= bounds_[value]) ++value;
    return value;
  }

 private:
  std::span<const double> bounds_;
  double lowest_, scale_;
  std::vector<std::uint32_t> starts_;
};

}  // namespace

bool BlockShares::is_one() const {
  return std::ranges::all_of(share, [&](double other) { return other == share.front(); });
}

template <class Sample>
MergedPicture merge_columns(std::span<const Sample> stored, std::size_t columns, std::size_t merged,
                            const StoredLight& table) {
  check(stored.size(), columns, table);
  check(stored, table);
  require(merged > 0, "merged", merged, "1 or more");
  struct Entry {
    double light, variance, known;
  };
  std::vector<Entry> entries;
  for (std::size_t k = 0; k < table.light.size(); ++k) {
    const bool known = std::isfinite(table.variance[k]);
    entries.push_back({known ? table.light[k] : 0, known ? table.variance[k] : 0, known ? 1.0 : 0.0});
  }
  const std::size_t rows = stored.size() / columns, blocks = blocks_of(columns, merged);
  MergedPicture result{std::vector<double>(rows * blocks), std::vector<double>(rows * blocks)};
  std::size_t to = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    check_interrupt();
    for (std::size_t first = 0; first < columns; first += merged, ++to) {
      Entry sum{0, 0, 0};
      for (std::size_t column = first; column < std::min(first + merged, columns); ++column) {
        const Entry& entry = entries[stored[row * columns + column]];
        sum.light += entry.light;
        sum.variance += entry.variance;
        sum.known += entry.known;
      }
      result.light[to] = sum.known > 0 ? sum.light / sum.known : 0;
      result.variance[to] =
          sum.known > 0 ? sum.variance / (sum.known * sum.known) : std::numeric_limits<double>::infinity();
    }
  }
  return result;
}

template <class Sample>
RestoredPicture<Sample> restore_picture(std::span<const Sample> stored, std::size_t columns, const BlockShares& shares,
                                        const Restoration& to, const StoredLight& table,
                                        std::span<const double> bounds) {
  check(stored.size(), columns, table);
  check(stored, table);
  const std::size_t rows = stored.size() / columns;
  require(bounds.size() + 1 == table.light.size(), "bounds", bounds.size(), "one less than stored values");
  require(to.rows.size() == rows, "rows", to.rows.size(), "one value a row");
  check(shares, rows, columns);
  const std::size_t down = blocks_of(rows, shares.block_rows), across = blocks_of(columns, shares.block_columns);
  const StoredValues value_of(table.light, bounds);
  std::vector<BetweenBlocks> places;
  for (std::size_t column = 0; column < columns; ++column)
    places.push_back(place_in_blocks(column, shares.block_columns, across));
  RestoredPicture<Sample> result{std::vector<Sample>(stored.size()), std::vector<std::uint8_t>(stored.size()),
                                 std::vector<float>(stored.size())};
  std::vector<std::uint8_t> is_saturated;
  for (const double variance : table.variance) is_saturated.push_back(std::isfinite(variance) ? 0 : 1);
  // Rows that were lit more burn here: below them is the brightest that is known.
  const auto brightest = static_cast<std::size_t>(std::ranges::find(is_saturated, 1) - is_saturated.begin());
  const std::size_t highest = brightest - std::min<std::size_t>(brightest, 1);
  std::vector<double> line(across);
  for (std::size_t row = 0; row < rows; ++row) {
    check_interrupt();
    const BetweenBlocks between = place_in_blocks(row, shares.block_rows, down);
    const double* const above = &shares.share[between.before * across];
    const double* const below = &shares.share[between.after * across];
    for (std::size_t k = 0; k < across; ++k) line[k] = above[k] + between.weight * (below[k] - above[k]);
    const double swing = to.rows[row] - 1, rise = to.level - 1;
    for (std::size_t column = 0; column < columns; ++column) {
      const std::size_t i = row * columns + column;
      const BetweenBlocks& at = places[column];
      const double share = line[at.before] + at.weight * (line[at.after] - line[at.before]);
      const double gain = (1 + share * rise) / std::max(1 + share * swing, min_left);
      const bool saturated = is_saturated[stored[i]] != 0;
      const bool dark = !saturated && gain > to.max_gain;
      const double light = table.light[stored[i]] * std::min(gain, to.max_gain);
      result.picture[i] = saturated ? stored[i] : static_cast<Sample>(std::min(value_of(light), highest));
      result.marks[i] = static_cast<std::uint8_t>(saturated ? PixelMark::saturated
                                                  : dark    ? PixelMark::dark
                                                            : PixelMark::restored);
      result.share[i] = static_cast<float>(share);
    }
  }
  return result;
}

template MergedPicture merge_columns(std::span<const std::uint8_t>, std::size_t, std::size_t, const StoredLight&);
template MergedPicture merge_columns(std::span<const std::uint16_t>, std::size_t, std::size_t, const StoredLight&);
template RestoredPicture<std::uint8_t> restore_picture(std::span<const std::uint8_t>, std::size_t, const BlockShares&,
                                                       const Restoration&, const StoredLight&, std::span<const double>);
template RestoredPicture<std::uint16_t> restore_picture(std::span<const std::uint16_t>, std::size_t, const BlockShares&,
                                                        const Restoration&, const StoredLight&,
                                                        std::span<const double>);

}  // namespace ocisac
