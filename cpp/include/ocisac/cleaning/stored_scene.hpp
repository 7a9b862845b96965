// Stored frames of one scene as linear light, and back as stored values under steady light.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "ocisac/camera/tone_curve.hpp"
#include "ocisac/cleaning/light_share.hpp"
#include "ocisac/cleaning/restore_picture.hpp"
#include "ocisac/core/views.hpp"

namespace ocisac {

constexpr std::size_t kWholePixels = 1U << 19U;  // means of neighbouring pixels in larger pictures

// A toe t of the tone curve stores light x as x²/(x + t·W), W: white light. Light of a stored value, and its slope.
double lifted_light(double stored, double toe, double white);
double slope_of_lifted(double stored, double toe, double white);

// Throws std::invalid_argument for a noise (DN) or a toe that no scene can have.
void check_stored(std::optional<double> noise, double toe);

class StoredScene {
 public:
  // `colours`: one view each, of one shape; their memory must outlive the scene. `noise`: standard deviation of a
  // pixel, DN; estimated where it is absent. Only a scene that is read has pictures.
  StoredScene(std::vector<AnyFramesView> colours, const ToneCurve& curve, std::optional<double> noise, double toe,
              bool is_read = true);

  void set_toe(double toe);  // converts with another toe of the tone curve

  // Linear light of one colour of one frame, or of all frames; neighbouring columns of large frames are averaged.
  [[nodiscard]] BandedPicture picture(std::size_t frame, std::size_t colour) const;
  [[nodiscard]] std::vector<BandedPicture> colours_of(std::size_t frame) const;

  [[nodiscard]] std::size_t frames() const { return frames_; }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t columns() const { return columns_; }  // of the camera
  [[nodiscard]] std::size_t colours() const { return colours_.size(); }
  [[nodiscard]] std::size_t merged() const { return merged_; }  // columns of the camera in each of a picture
  [[nodiscard]] double noise() const { return noise_; }
  [[nodiscard]] double toe() const { return toe_; }
  [[nodiscard]] double white() const { return white_; }  // light of a white pixel

  // True for integers, which `restore` takes.
  [[nodiscard]] bool by_table() const { return !table_.light.empty(); }

  // Writes stored values under steady light, marks and shares of one colour of one frame (restore_picture).
  template <class Sample>
  void restore(std::size_t frame, std::size_t colour, const BlockShares& shares, const Restoration& to,
               const RestoredPicture<Sample>& result) const;

 private:
  void make_table();
  [[nodiscard]] double variance_at(double value, double top) const;  // of the light of a stored value
  [[nodiscard]] Blocks converted(std::size_t frame, std::size_t colour) const;

  std::vector<AnyFramesView> colours_;
  ToneCurve curve_;
  std::size_t frames_, rows_, columns_, merged_;
  double noise_, white_, toe_ = 0;
  StoredTable table_;
  std::vector<Blocks> pictures_;  // of each frame, of each colour
};

}  // namespace ocisac
