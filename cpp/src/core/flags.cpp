#include "ocisac/core/flags.hpp"

#include <array>
#include <utility>

namespace ocisac {

namespace {

constexpr std::array<std::pair<Flags, const char*>, 20> kNames{{{flag::saturated, "saturated"},
                                                                {flag::near_null, "near_null"},
                                                                {flag::weak, "weak"},
                                                                {flag::few_cycles, "few_cycles"},
                                                                {flag::aliased, "aliased"},
                                                                {flag::unresolvable, "unresolvable"},
                                                                {flag::no_light, "no_light"},
                                                                {flag::off_bin, "off_bin"},
                                                                {flag::ill_conditioned, "ill_conditioned"},
                                                                {flag::harmonics_dropped, "harmonics_dropped"},
                                                                {flag::no_tone, "no_tone"},
                                                                {flag::at_bound, "at_bound"},
                                                                {flag::no_signal, "no_signal"},
                                                                {flag::too_few_edges, "too_few_edges"},
                                                                {flag::long_exposure, "long_exposure"},
                                                                {flag::periodic, "periodic"},
                                                                {flag::model_misfit, "model_misfit"},
                                                                {flag::quantised, "quantised"},
                                                                {flag::ambiguous_motion, "ambiguous_motion"},
                                                                {flag::ambiguous_kind, "ambiguous_kind"}}};

}  // namespace

const char* flag_name(Flags bit) {
  for (const auto& [known, name] : kNames)
    if (known == bit) return name;
  return nullptr;
}

std::vector<std::string> flag_names(Flags flags) {
  std::vector<std::string> names;
  for (const auto& [bit, name] : kNames)
    if (flags & bit) names.emplace_back(name);
  return names;
}

}  // namespace ocisac
