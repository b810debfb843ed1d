// SPDX-License-Identifier: GPL-3.0-or-later
//
// A coupling that follows a script, in the way of preCICE's adapter: it looks up its fields, sets the displacement of
// the plate's faces for the step that comes, and at the end of a window takes time, points and fields back, or goes on.
//
//     iterations (1.5 1);   // of a window, and by how much each one goes too far
//     subSteps (2 1 3);     // time steps of a window, of equal length: in the first iteration of the run, the next, …
//     windows 4;            // then the run ends
//     keepWeights yes;      // of the interpolation to points: those of the mesh that the run begins with
//     stopAfter 2;          // windows: the run is broken off, as by a fault
#include "Time.H"
#include "addToRunTimeSelectionTable.H"
#include "fvMesh.H"
#include "fvMeshFunctionObject.H"
#include "pointFields.H"
#include "primitivePatchInterpolation.H"
#include "volFields.H"

namespace Foam
{
namespace functionObjects
{

class scriptedCoupling : public fvMeshFunctionObject
{
    scalarList factors_;
    labelList subSteps_;
    label windows_, stopAfter_, iteration_ = 0, window_ = 0, index_ = 0, done_ = 0;
    scalar value_ = 0, length_;
    bool keepsWeights_;
    pointField points_;
    vectorField start_;
    volVectorField* faces_ = nullptr;
    pointVectorField* nodes_ = nullptr;
    std::unique_ptr<pointVectorField> saved_;
    std::unique_ptr<primitivePatchInterpolation> weights_;

    Time& time() { return const_cast<Time&>(time_); }
    fvMesh& mesh() { return const_cast<fvMesh&>(mesh_); }

    void save()
    {
        index_ = time().timeIndex();
        value_ = time().value();
        points_ = mesh().points();
        saved_.reset(new pointVectorField("saved", *nodes_));
    }

    void setPlate()
    {
        const label patchi = mesh().boundaryMesh().findPatchID("plate");
        const fvPatch& plate = mesh().boundary()[patchi];
        vectorField& there = faces_->boundaryFieldRef()[patchi];
        if (start_.empty())
        {
            start_ = plate.Cf() - there;
            Info<< "undeformed faces " << gSum(mag(start_)) << endl;
        }
        if (!weights_ || !keepsWeights_)
        {
            weights_.reset(new primitivePatchInterpolation(plate.patch()));
        }
        const scalar angle = factors_[iteration_]*(time().value() + time().deltaTValue());
        there = ((start_ - point(0.85, 0.5, 0)) ^ vector(0, 0, -sin(angle)));
        refCast<vectorField>(nodes_->boundaryFieldRef()[patchi]) =
            weights_->faceToPointInterpolate(there);
    }

public:

    TypeName("scriptedCoupling");

    scriptedCoupling(const word& name, const Time& time, const dictionary& dict)
    :
        fvMeshFunctionObject(name, time, dict),
        factors_(dict.lookup("iterations")),
        subSteps_(dict.lookup("subSteps")),
        windows_(dict.get<label>("windows")),
        stopAfter_(dict.lookupOrDefault<label>("stopAfter", -1)),
        length_(subSteps_[0]*time.deltaTValue()),
        keepsWeights_(dict.lookupOrDefault("keepWeights", false)),
        faces_(&mesh_.lookupObjectRef<volVectorField>("cellDisplacement")),
        nodes_(&mesh_.lookupObjectRef<pointVectorField>("pointDisplacement"))
    {
        save();
        setPlate();
    }

    virtual bool execute()
    {
        if (time().timeIndex() - index_ == subSteps_[done_ % subSteps_.size()])
        {
            time().setDeltaT(length_/subSteps_[++done_ % subSteps_.size()]);
            if (++iteration_ < factors_.size())
            {
                time().setTime(value_, index_);
                mesh().movePoints(points_);
                *nodes_ == *saved_;
            }
            else
            {
                iteration_ = 0;
                ++window_;
                time().writeNow();
                save();
            }
        }
        if (window_ == stopAfter_)
        {
            FatalErrorInFunction << "broken off" << exit(FatalError);
        }
        if (window_ == windows_)
        {
            time().setEndTime(time().value());
        }
        setPlate();
        return true;
    }

    virtual bool write() { return true; }
};

defineTypeNameAndDebug(scriptedCoupling, 0);
addToRunTimeSelectionTable(functionObject, scriptedCoupling, dictionary);

}
}
